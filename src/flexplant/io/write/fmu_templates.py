"""Text of the C source of an FMU; the declarations restate the public interface of FMI 2.0."""

SOURCE = r"""/* $title. FMI 2.0 co-simulation of a modal plant, written by flexplant. Needs a C99 compiler and nothing else.

   eta'' + 2 zeta omega eta' + omega^2 eta = shape_in u;  y = position_out eta + velocity_out eta' + direct u.
   Each step is exact for inputs held over it. */
#include <stddef.h>
#include <string.h>

#define GUID "@guid@"
enum { MODES = $n, INPUTS = $nu, OUTPUTS = $ny };

$tables
/* ---- FMI 2.0 interface ---- */
#if defined _WIN32
#define EXPORT __declspec(dllexport)
#elif defined __GNUC__
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Char;
typedef const fmi2Char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef struct {
  void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
  void *(*allocateMemory)(size_t, size_t);
  void (*freeMemory)(void *);
  void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
  fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

/* ---- the plant ---- */
typedef struct {
  double position[MODES], velocity[MODES], input[INPUTS];
  double time, step;                        /* step: the one that the transition below belongs to */
  double f[4][MODES], h[2][MODES];          /* next = f now + h force */
} State;

typedef struct {
  State now;
  char name[256];
  fmi2CallbackFunctions call;
} Instance;

/* e = exp(a) of a 3x3 matrix: scaling, Taylor series, squaring */
static void exponential(double a[3][3], double e[3][3]) {
  double norm = 0, scale = 1, term[3][3], next[3][3];
  int squarings = 0;
  for (int i = 0; i < 3; i++) {
    double sum = 0;
    for (int j = 0; j < 3; j++) sum += a[i][j] < 0 ? -a[i][j] : a[i][j];
    if (sum > norm) norm = sum;
  }
  while (norm * scale > 0.5 && squarings < 60) {
    scale *= 0.5;
    squarings++;
  }
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) e[i][j] = term[i][j] = i == j;
  for (int order = 1; order <= 16; order++) {
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++) {
        next[i][j] = 0;
        for (int k = 0; k < 3; k++) next[i][j] += term[i][k] * a[k][j] * scale / order;
      }
    memcpy(term, next, sizeof term);
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++) e[i][j] += term[i][j];
  }
  while (squarings-- > 0) {
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++) {
        next[i][j] = 0;
        for (int k = 0; k < 3; k++) next[i][j] += e[i][k] * e[k][j];
      }
    memcpy(e, next, sizeof next);
  }
}

/* Transition of every mode in the states (s eta, dt eta'), s = max(1, omega dt), which keeps the matrix well scaled. */
static void prepare(State *state, double dt) {
  for (int i = 0; i < MODES; i++) {
    const double x = omega[i] * dt, s = x > 1 ? x : 1;
    double a[3][3] = {{0, s, 0}, {-x * x / s, -2 * zeta[i] * x, 1}, {0, 0, 0}}, e[3][3];
    exponential(a, e);
    state->f[0][i] = e[0][0];
    state->f[1][i] = e[0][1] * dt / s;
    state->f[2][i] = e[1][0] * s / dt;
    state->f[3][i] = e[1][1];
    state->h[0][i] = e[0][2] * dt * dt / s;
    state->h[1][i] = e[1][2] * dt;
  }
  state->step = dt;
}

static void advance(State *state) {
  for (int i = 0; i < MODES; i++) {
    const double x = state->position[i], v = state->velocity[i];
    double force = 0;
    for (int j = 0; j < INPUTS; j++) force += shape_in[j][i] * state->input[j];
    state->position[i] = state->f[0][i] * x + state->f[1][i] * v + state->h[0][i] * force;
    state->velocity[i] = state->f[2][i] * x + state->f[3][i] * v + state->h[1][i] * force;
  }
}

static double output(const State *state, int k) {
  double sum = 0;
  for (int j = 0; j < INPUTS; j++) sum += direct[k][j] * state->input[j];
  for (int i = 0; i < MODES; i++) sum += position_out[i][k] * state->position[i] + velocity_out[i][k] * state->velocity[i];
  return sum;
}

static fmi2Status fail(const Instance *m, const char *text) {
  if (m && m->call.logger) m->call.logger(m->call.componentEnvironment, m->name, fmi2Error, "logStatusError", text);
  return fmi2Error;
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) {
  (void)c, (void)on, (void)n, (void)names;
  return fmi2OK;
}

EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                     const fmi2CallbackFunctions *call, fmi2Boolean visible, fmi2Boolean logging) {
  (void)resources, (void)visible, (void)logging;
  if (type != fmi2CoSimulation || !call || !call->allocateMemory || !call->freeMemory || !guid || strcmp(guid, GUID)) return NULL;
  Instance *m = call->allocateMemory(1, sizeof(Instance));
  if (!m) return NULL;
  memset(m, 0, sizeof *m);
  m->call = *call;
  if (name) strncpy(m->name, name, sizeof m->name - 1);
  return m;
}

EXPORT void fmi2FreeInstance(fmi2Component c) {
  if (c) ((Instance *)c)->call.freeMemory(c);
}

EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                                      fmi2Boolean has_stop, fmi2Real stop) {
  (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
  ((Instance *)c)->now.time = start;
  return fmi2OK;
}

EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
EXPORT fmi2Status fmi2Terminate(fmi2Component c) { return c ? fmi2OK : fmi2Error; }

EXPORT fmi2Status fmi2Reset(fmi2Component c) {
  memset(&((Instance *)c)->now, 0, sizeof(State));
  return fmi2OK;
}

EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
  const Instance *m = c;
  for (size_t i = 0; i < n; i++) {
    if (vr[i] < INPUTS) value[i] = m->now.input[vr[i]];
    else if (vr[i] < INPUTS + OUTPUTS) value[i] = output(&m->now, (int)(vr[i] - INPUTS));
    else return fail(m, "fmi2GetReal: no such variable");
  }
  return fmi2OK;
}

EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
  Instance *m = c;
  for (size_t i = 0; i < n; i++) {
    if (vr[i] >= INPUTS) return fail(m, "fmi2SetReal: only inputs can be set");
    m->now.input[vr[i]] = value[i];
  }
  return fmi2OK;
}

EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_going_back) {
  Instance *m = c;
  (void)no_going_back;
  if (!(step >= 0)) return fail(m, "fmi2DoStep: the step must not be negative");
  if (step > 0) {
    if (step != m->now.step) prepare(&m->now, step);
    advance(&m->now);
  }
  m->now.time = time + step;
  return fmi2OK;
}

EXPORT fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *saved) {
  Instance *m = c;
  if (!*saved) *saved = m->call.allocateMemory(1, sizeof(State));
  if (!*saved) return fail(m, "fmi2GetFMUstate: no memory");
  memcpy(*saved, &m->now, sizeof(State));
  return fmi2OK;
}

EXPORT fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate saved) {
  if (!saved) return fail(c, "fmi2SetFMUstate: no state");
  memcpy(&((Instance *)c)->now, saved, sizeof(State));
  return fmi2OK;
}

EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *saved) {
  if (*saved) ((Instance *)c)->call.freeMemory(*saved);
  *saved = NULL;
  return fmi2OK;
}

EXPORT fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
  if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
  *value = ((Instance *)c)->now.time;
  return fmi2OK;
}

/* ---- what this plant does not have ---- */
#define NONE(name, ...) EXPORT fmi2Status name(__VA_ARGS__)
NONE(fmi2GetInteger, fmi2Component c, const fmi2ValueReference v[], size_t n, fmi2Integer x[]) {
  (void)v, (void)x;
  return n ? fail(c, "there are no integers") : fmi2OK;
}
NONE(fmi2GetBoolean, fmi2Component c, const fmi2ValueReference v[], size_t n, fmi2Boolean x[]) {
  (void)v, (void)x;
  return n ? fail(c, "there are no booleans") : fmi2OK;
}
NONE(fmi2GetString, fmi2Component c, const fmi2ValueReference v[], size_t n, fmi2String x[]) {
  (void)v, (void)x;
  return n ? fail(c, "there are no strings") : fmi2OK;
}
NONE(fmi2SetInteger, fmi2Component c, const fmi2ValueReference v[], size_t n, const fmi2Integer x[]) {
  (void)v, (void)x;
  return n ? fail(c, "there are no integers") : fmi2OK;
}
NONE(fmi2SetBoolean, fmi2Component c, const fmi2ValueReference v[], size_t n, const fmi2Boolean x[]) {
  (void)v, (void)x;
  return n ? fail(c, "there are no booleans") : fmi2OK;
}
NONE(fmi2SetString, fmi2Component c, const fmi2ValueReference v[], size_t n, const fmi2String x[]) {
  (void)v, (void)x;
  return n ? fail(c, "there are no strings") : fmi2OK;
}
NONE(fmi2SerializedFMUstateSize, fmi2Component c, fmi2FMUstate s, size_t *n) {
  (void)s, (void)n;
  return fail(c, "states are not serialised");
}
NONE(fmi2SerializeFMUstate, fmi2Component c, fmi2FMUstate s, fmi2Byte b[], size_t n) {
  (void)s, (void)b, (void)n;
  return fail(c, "states are not serialised");
}
NONE(fmi2DeSerializeFMUstate, fmi2Component c, const fmi2Byte b[], size_t n, fmi2FMUstate *s) {
  (void)b, (void)n, (void)s;
  return fail(c, "states are not serialised");
}
NONE(fmi2GetDirectionalDerivative, fmi2Component c, const fmi2ValueReference u[], size_t nu, const fmi2ValueReference k[],
     size_t nk, const fmi2Real dk[], fmi2Real du[]) {
  (void)u, (void)nu, (void)k, (void)nk, (void)dk, (void)du;
  return fail(c, "directional derivatives are not provided");
}
NONE(fmi2SetRealInputDerivatives, fmi2Component c, const fmi2ValueReference v[], size_t n, const fmi2Integer o[],
     const fmi2Real x[]) {
  (void)v, (void)n, (void)o, (void)x;
  return fail(c, "inputs are held over a step");
}
NONE(fmi2GetRealOutputDerivatives, fmi2Component c, const fmi2ValueReference v[], size_t n, const fmi2Integer o[],
     fmi2Real x[]) {
  (void)v, (void)n, (void)o, (void)x;
  return fail(c, "output derivatives are not provided");
}
NONE(fmi2CancelStep, fmi2Component c) { return fail(c, "steps are never pending"); }
NONE(fmi2GetStatus, fmi2Component c, const fmi2StatusKind k, fmi2Status *x) {
  (void)c, (void)k, (void)x;
  return fmi2Discard;
}
NONE(fmi2GetIntegerStatus, fmi2Component c, const fmi2StatusKind k, fmi2Integer *x) {
  (void)c, (void)k, (void)x;
  return fmi2Discard;
}
NONE(fmi2GetBooleanStatus, fmi2Component c, const fmi2StatusKind k, fmi2Boolean *x) {
  (void)c, (void)k;
  *x = 0;
  return k == fmi2Terminated ? fmi2OK : fmi2Discard;
}
NONE(fmi2GetStringStatus, fmi2Component c, const fmi2StatusKind k, fmi2String *x) {
  (void)c, (void)k, (void)x;
  return fmi2Discard;
}
"""
