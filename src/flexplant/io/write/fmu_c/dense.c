
/* ---- x' = a x + b u with a full matrix: a step costs STATES^2, a new step size about 20 (STATES + 2 INPUTS)^3 ---- */
enum { AUGMENTED = STATES + 2 * INPUTS };

typedef struct {
  double f[STATES][STATES], g[STATES][INPUTS], r[STATES][INPUTS]; /* next = f x + g u + r u' */
  double work[4][AUGMENTED * AUGMENTED];
} Transition;

/* f = exp(a h), g and r the first and second integrals with b, from exp of [[a h, b h, 0], [0, 0, I], [0, 0, 0]] */
static void prepare(Transition *to, double h) {
  double *matrix = to->work[0], *e = to->work[1];
  memset(matrix, 0, sizeof to->work[0]);
  for (int i = 0; i < STATES; i++) {
    for (int k = 0; k < STATES; k++) matrix[AUGMENTED * i + k] = dense_a[i][k] * h;
    for (int j = 0; j < INPUTS; j++) matrix[AUGMENTED * i + STATES + j] = dense_b[i][j] * h;
  }
  for (int j = 0; j < INPUTS; j++) matrix[AUGMENTED * (STATES + j) + STATES + INPUTS + j] = 1;
  if (!SAMPLED) exponential(AUGMENTED, matrix, e, to->work[2], to->work[3]);
  for (int i = 0; i < STATES; i++) {
    for (int k = 0; k < STATES; k++) to->f[i][k] = SAMPLED ? dense_a[i][k] : e[AUGMENTED * i + k];
    for (int j = 0; j < INPUTS; j++) {
      to->g[i][j] = SAMPLED ? dense_b[i][j] : e[AUGMENTED * i + STATES + j];
      to->r[i][j] = SAMPLED ? 0 : e[AUGMENTED * i + STATES + INPUTS + j] * h;
    }
  }
}

static void advance(State *now, const Transition *to, bool sloped) {
  double next[STATES];
  for (int i = 0; i < STATES; i++) {
    next[i] = 0;
    for (int k = 0; k < STATES; k++) next[i] += to->f[i][k] * now->x[k];
    for (int j = 0; j < INPUTS; j++) next[i] += to->g[i][j] * now->input[j];
    if (sloped)
      for (int j = 0; j < INPUTS; j++) next[i] += to->r[i][j] * now->slope[j];
  }
  memcpy(now->x, next, sizeof next);
}

static double output(const State *now, int k) {
  double sum = 0;
  for (int j = 0; j < INPUTS; j++) sum += direct[k][j] * now->input[j];
  for (int i = 0; i < STATES; i++) sum += dense_c[k][i] * now->x[i];
  return sum;
}
