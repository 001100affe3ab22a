
/* ---- blocks of two states: x_i' = a_i x_i + b_i u; row 0 and row 1 of block i are x[i] and x[BLOCKS + i] ---- */
typedef struct {
  double f[2][2][BLOCKS], g[2][2][BLOCKS], r[2][2][BLOCKS]; /* next = f x + g (b u) + r (b u') */
} Transition;

/* f = exp(a h), g and r its first and second integrals, from the exponential of [[a h, I, 0], [0, 0, I], [0, 0, 0]] */
static void prepare(Transition *to, double h) {
  for (int i = 0; i < BLOCKS; i++) {
    double matrix[36] = {0}, e[36], term[36], next[36];
    for (int row = 0; row < 2; row++) {
      for (int column = 0; column < 2; column++) matrix[6 * row + column] = block_a[row][column][i] * h;
      matrix[6 * row + 2 + row] = matrix[6 * (2 + row) + 4 + row] = 1;
    }
    exponential(6, matrix, e, term, next);
    for (int row = 0; row < 2; row++)
      for (int column = 0; column < 2; column++) {
        const double *from = e + 6 * row + column;
        to->f[row][column][i] = SAMPLED ? block_a[row][column][i] : from[0];
        to->g[row][column][i] = SAMPLED ? row == column : from[2] * h;
        to->r[row][column][i] = SAMPLED ? 0 : from[4] * h * h;
      }
  }
}

/* force = b u; rows that no input drives are not summed */
static void drive(const double *u, double force[2][BLOCKS]) {
  memset(force[0], 0, 2 * sizeof force[0]);
  for (int j = 0; j < INPUTS; j++)
    for (int i = 0; i < BLOCKS; i++) force[1][i] += block_b1[j][i] * u[j];
#if FIRST_ROWS_DRIVEN
  for (int j = 0; j < INPUTS; j++)
    for (int i = 0; i < BLOCKS; i++) force[0][i] += block_b0[j][i] * u[j];
#endif
}

static void advance(State *now, const Transition *to, bool sloped) {
  double force[2][BLOCKS];
  drive(now->input, force);
  for (int i = 0; i < BLOCKS; i++) {
    const double x = now->x[i], v = now->x[BLOCKS + i];
    for (int row = 0; row < 2; row++)
      now->x[row * BLOCKS + i] = to->f[row][0][i] * x + to->f[row][1][i] * v + to->g[row][0][i] * force[0][i] +
                                 to->g[row][1][i] * force[1][i];
  }
  if (!sloped) return;
  drive(now->slope, force);
  for (int row = 0; row < 2; row++)
    for (int i = 0; i < BLOCKS; i++)
      now->x[row * BLOCKS + i] += to->r[row][0][i] * force[0][i] + to->r[row][1][i] * force[1][i];
}

static double output(const State *now, int k) {
  double sum = 0;
  for (int j = 0; j < INPUTS; j++) sum += direct[k][j] * now->input[j];
  for (int i = 0; i < BLOCKS; i++) sum += block_c0[k][i] * now->x[i] + block_c1[k][i] * now->x[BLOCKS + i];
  return sum;
}
