"""Texts of the C source of a plant; $names are filled in by `c_source`."""

HEADER = """\
/* $title: plant sampled every $dt s, $hold. Written by flexplant as c_source.
   $how.

   ${p}_state s;                          all memory there is, no heap
   ${p}_reset(&s);                        at rest
   ${p}_step(&s, u, y);                   y = outputs now, then one step of $dt s
   ${p}_output(&s, u, y) and ${p}_advance(&s, u) do the two halves, for loops that close on y.
   Define ${P}_REAL as float for single precision, the same for every file that includes this one. */
#ifndef ${P}_H
#define ${P}_H

#ifndef ${P}_REAL
#define ${P}_REAL double
#endif
#define ${P}_DT $dt

#ifdef __cplusplus
extern "C" {
#endif

typedef ${P}_REAL ${p}_real;

enum { ${P}_SIZE = $n, ${P}_INPUTS = $input_count, ${P}_OUTPUTS = $output_count };

enum ${p}_input {
$input_constants
};

enum ${p}_output {
$output_constants
};

typedef struct {
  ${p}_real position[${P}_SIZE]; /* modal displacements, or the states */
  ${p}_real velocity[${P}_SIZE]; /* modal velocities */
} ${p}_state;

extern const char *const ${p}_input_names[${P}_INPUTS];
extern const char *const ${p}_output_names[${P}_OUTPUTS];

void ${p}_reset(${p}_state *state);
void ${p}_output(const ${p}_state *state, const ${p}_real *u, ${p}_real *y);
void ${p}_advance(${p}_state *state, const ${p}_real *u);
void ${p}_step(${p}_state *state, const ${p}_real *u, ${p}_real *y);

#ifdef __cplusplus
}
#endif
#endif
"""

COMMON = """\
/* $title. Written by flexplant as c_source; see $header_name. */
#include "$header_name"

const char *const ${p}_input_names[${P}_INPUTS] = {
  $input_names};
const char *const ${p}_output_names[${P}_OUTPUTS] = {
  $output_names};

/* The numbers are doubles, and are rounded on purpose where ${P}_REAL is float. */
#if defined __clang__
#pragma clang diagnostic push
#pragma clang diagnostic ignored "-Wconversion"
#elif defined __GNUC__
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wfloat-conversion"
#elif defined _MSC_VER
#pragma warning(push)
#pragma warning(disable : 4305)
#endif
$tables
#if defined __clang__
#pragma clang diagnostic pop
#elif defined __GNUC__
#pragma GCC diagnostic pop
#elif defined _MSC_VER
#pragma warning(pop)
#endif

void ${p}_reset(${p}_state *state) {
  for (int i = 0; i < ${P}_SIZE; i++) {
    state->position[i] = 0;
    state->velocity[i] = 0;
  }
}

void ${p}_step(${p}_state *state, const ${p}_real *u, ${p}_real *y) {
  ${p}_real held[${P}_INPUTS];
  for (int j = 0; j < ${P}_INPUTS; j++) held[j] = u[j];
  ${p}_output(state, held, y);
  ${p}_advance(state, held);
}
"""

# Outputs are summed with the modes outside and the outputs inside: that vectorises without reordering a sum.
OUTPUT = """
/* y = position_out x + velocity_out v + direct u, with x and v the two states of each mode or block */
void ${p}_output(const ${p}_state *state, const ${p}_real *u, ${p}_real *y) {
  ${p}_real even[${P}_OUTPUTS], odd[${P}_OUTPUTS];
  for (int k = 0; k < ${P}_OUTPUTS; k++) {
    even[k] = 0;
    odd[k] = 0;
    for (int j = 0; j < ${P}_INPUTS; j++) even[k] += ${p}_direct[k][j] * u[j];
  }
  for (int i = 0; i < ${P}_SIZE; i++) {
    const ${p}_real x = state->position[i];
    for (int k = 0; k < ${P}_OUTPUTS; k++) even[k] += ${p}_position_out[i][k] * x;
$velocity_terms  }
  for (int k = 0; k < ${P}_OUTPUTS; k++) y[k] = even[k] + odd[k];
}
"""

MODAL = (
    COMMON
    + OUTPUT
    + """
/* eta[k+1] = f eta[k] + h (shape_in u), the exact solution over a step */
void ${p}_advance(${p}_state *state, const ${p}_real *u) {
  ${p}_real held[${P}_INPUTS];
  for (int j = 0; j < ${P}_INPUTS; j++) held[j] = u[j];
  for (int i = 0; i < ${P}_SIZE; i++) {
    const ${p}_real x = state->position[i], v = state->velocity[i];
    ${p}_real force = 0;
    for (int j = 0; j < ${P}_INPUTS; j++) force += ${p}_shape_in[j][i] * held[j];
    state->position[i] = ${p}_f00[i] * x + ${p}_f01[i] * v + ${p}_h0[i] * force;
    state->velocity[i] = ${p}_f10[i] * x + ${p}_f11[i] * v + ${p}_h1[i] * force;
  }
}
"""
)

BLOCKS = (
    COMMON
    + OUTPUT
    + """
/* the two states of each block: x[k+1] = f x[k] + in u[k] */
void ${p}_advance(${p}_state *state, const ${p}_real *u) {
  ${p}_real held[${P}_INPUTS];
  for (int j = 0; j < ${P}_INPUTS; j++) held[j] = u[j];
  for (int i = 0; i < ${P}_SIZE; i++) {
    const ${p}_real x = state->position[i], v = state->velocity[i];
    ${p}_real first = 0, second = 0;
    for (int j = 0; j < ${P}_INPUTS; j++) {
      first += ${p}_first_in[j][i] * held[j];
      second += ${p}_second_in[j][i] * held[j];
    }
    state->position[i] = ${p}_f00[i] * x + ${p}_f01[i] * v + first;
    state->velocity[i] = ${p}_f10[i] * x + ${p}_f11[i] * v + second;
  }
}
"""
)

VELOCITY_TERMS = """\
    const ${p}_real v = state->velocity[i];
    for (int k = 0; k < ${P}_OUTPUTS; k++) odd[k] += ${p}_velocity_out[i][k] * v;
"""

DENSE = (
    COMMON
    + """
/* y = C x + D u */
void ${p}_output(const ${p}_state *state, const ${p}_real *u, ${p}_real *y) {
  for (int k = 0; k < ${P}_OUTPUTS; k++) {
    ${p}_real sum = 0;
    for (int i = 0; i < ${P}_SIZE; i++) sum += ${p}_c[k][i] * state->position[i];
    for (int j = 0; j < ${P}_INPUTS; j++) sum += ${p}_direct[k][j] * u[j];
    y[k] = sum;
  }
}

/* x[k+1] = A x[k] + B u[k]; the velocities only keep the old state */
void ${p}_advance(${p}_state *state, const ${p}_real *u) {
  for (int i = 0; i < ${P}_SIZE; i++) state->velocity[i] = state->position[i];
  for (int i = 0; i < ${P}_SIZE; i++) {
    ${p}_real sum = 0;
    for (int j = 0; j < ${P}_SIZE; j++) sum += ${p}_a[i][j] * state->velocity[j];
    for (int j = 0; j < ${P}_INPUTS; j++) sum += ${p}_b[i][j] * u[j];
    state->position[i] = sum;
  }
}
"""
)
