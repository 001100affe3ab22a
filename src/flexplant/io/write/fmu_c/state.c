#include <float.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined _WIN32
#define EXPORT __declspec(dllexport)
#elif defined __GNUC__
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

/* ---- the plant: all that an importer may save and bring back ---- */
typedef enum { INSTANTIATED, INITIALIZING, RUNNING, TERMINATED } Phase;

typedef struct {
  double x[STATES];
  double input[INPUTS], slope[INPUTS]; /* u = input + slope (t - time) over the next step */
  double time;
  Phase phase;
} State;

static double magnitude(double value) { return value < 0 ? -value : value; }

/* c = a b, n x n */
static void multiply(int n, const double *a, const double *b, double *c) {
  memset(c, 0, sizeof(double) * (size_t)n * (size_t)n);
  for (int i = 0; i < n; i++)
    for (int k = 0; k < n; k++) {
      const double factor = a[i * n + k];
      if (factor == 0) continue;
      for (int j = 0; j < n; j++) c[i * n + j] += factor * b[k * n + j];
    }
}

/* e = exp(a), n x n: scaling, Taylor series, squaring; a is overwritten, term and next are work space of the same size */
static void exponential(int n, double *a, double *e, double *term, double *next) {
  const size_t bytes = sizeof(double) * (size_t)n * (size_t)n;
  double norm = 0, scale = 1;
  int squarings = 0;
  for (int i = 0; i < n; i++) {
    double sum = 0;
    for (int j = 0; j < n; j++) sum += magnitude(a[i * n + j]);
    if (sum > norm) norm = sum;
  }
  while (norm * scale > 0.5 && squarings < 1000) {
    scale *= 0.5;
    squarings++;
  }
  for (int i = 0; i < n * n; i++) {
    a[i] *= scale;
    e[i] = term[i] = i % (n + 1) == 0;
  }
  for (int order = 1; order <= 16; order++) {
    multiply(n, term, a, next);
    for (int i = 0; i < n * n; i++) e[i] += term[i] = next[i] / order;
  }
  for (; squarings > 0; squarings--) {
    multiply(n, e, e, next);
    memcpy(e, next, bytes);
  }
}
