
/* ---- FMI 2.0: the public interface restated, and its functions ---- */
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

typedef struct {
  Plant plant;
  char name[256];
  fmi2CallbackFunctions call;
} Instance;

/* fmi2OK where there is no text; else the text goes to the importer's log */
static fmi2Status told(const Instance *m, const char *text) {
  if (m && !text) return fmi2OK;
  if (m && m->call.logger) m->call.logger(m->call.componentEnvironment, m->name, fmi2Error, "logStatusError", text);
  return fmi2Error;
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) {
  (void)on, (void)n, (void)names; /* there are only errors, and these are always told */
  return told(c, NULL);
}

EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                     const fmi2CallbackFunctions *call, fmi2Boolean visible, fmi2Boolean logging) {
  Instance *m;
  (void)resources, (void)visible, (void)logging;
  if (!call || !call->allocateMemory || !call->freeMemory) return NULL;
  if (type != fmi2CoSimulation || !guid || strcmp(guid, TOKEN) != 0) {
    if (call->logger)
      call->logger(call->componentEnvironment, name, fmi2Error, "logStatusError",
                   "fmi2Instantiate: this is another FMU than its modelDescription.xml tells, or not co-simulation");
    return NULL;
  }
  m = call->allocateMemory(1, sizeof(Instance));
  if (!m) return NULL;
  memset(m, 0, sizeof *m);
  m->call = *call;
  for (size_t i = 0; name && name[i] && i + 1 < sizeof m->name; i++) m->name[i] = name[i];
  return m;
}

EXPORT void fmi2FreeInstance(fmi2Component c) {
  if (c) ((Instance *)c)->call.freeMemory(c);
}

EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                                      fmi2Boolean has_stop, fmi2Real stop) {
  (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
  if (c) ((Instance *)c)->plant.now.time = start;
  return told(c, NULL);
}

#define PHASE(function, before, next)                                                          \
  EXPORT fmi2Status function(fmi2Component c) {                                                \
    return told(c, c ? enter_phase(&((Instance *)c)->plant.now, before, next) : NULL); \
  }
PHASE(fmi2EnterInitializationMode, INSTANTIATED, INITIALIZING)
PHASE(fmi2ExitInitializationMode, INITIALIZING, RUNNING)
PHASE(fmi2Terminate, RUNNING, TERMINATED)

EXPORT fmi2Status fmi2Reset(fmi2Component c) {
  if (c) memset(&((Instance *)c)->plant.now, 0, sizeof(State));
  return told(c, NULL);
}

EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
  const Instance *m = c;
  for (size_t i = 0; m && i < n; i++) {
    if (vr[i] >= INPUTS + OUTPUTS) return told(m, "fmi2GetReal: no variable has this value reference");
    value[i] = channel(&m->plant.now, vr[i]);
  }
  return told(m, NULL);
}

EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
  Instance *m = c;
  for (size_t i = 0; m && i < n; i++) {
    if (vr[i] >= INPUTS) return told(m, "fmi2SetReal: no input has this value reference");
    set_input(&m->plant.now, vr[i], value[i]);
  }
  return told(m, NULL);
}

EXPORT fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                              const fmi2Integer order[], const fmi2Real value[]) {
  Instance *m = c;
  for (size_t i = 0; m && i < n; i++) {
    if (SAMPLED) return told(m, "fmi2SetRealInputDerivatives: inputs of a sampled plant are held");
    if (vr[i] >= INPUTS) return told(m, "fmi2SetRealInputDerivatives: no input has this value reference");
    if (order[i] != 1) return told(m, "fmi2SetRealInputDerivatives: only first derivatives are taken");
    m->plant.now.slope[vr[i]] = value[i];
  }
  return told(m, NULL);
}

EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_going_back) {
  Instance *m = c;
  (void)no_going_back;
  return told(m, m ? do_step(&m->plant, time, step) : NULL);
}

EXPORT fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *saved) {
  Instance *m = c;
  if (m && saved && !*saved) *saved = m->call.allocateMemory(1, sizeof(State));
  return told(m, m ? copy_state(saved ? *saved : NULL, &m->plant.now, sizeof(State)) : NULL);
}

EXPORT fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate saved) {
  Instance *m = c;
  return told(m, m ? copy_state(&m->plant.now, saved, sizeof(State)) : NULL);
}

EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *saved) {
  Instance *m = c;
  if (m && saved && *saved) m->call.freeMemory(*saved);
  if (m && saved) *saved = NULL;
  return told(m, NULL);
}

EXPORT fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate saved, size_t *size) {
  (void)saved;
  *size = sizeof(State);
  return told(c, NULL);
}

EXPORT fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate saved, fmi2Byte bytes[], size_t size) {
  return told(c, copy_state(bytes, saved, size));
}

EXPORT fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *saved) {
  Instance *m = c;
  if (m && saved && !*saved) *saved = m->call.allocateMemory(1, sizeof(State));
  return told(m, copy_state(saved ? *saved : NULL, bytes, size));
}

EXPORT fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
  if (!c || kind != fmi2LastSuccessfulTime) return fmi2Discard;
  *value = ((Instance *)c)->plant.now.time;
  return fmi2OK;
}

EXPORT fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
  (void)c;
  *value = 0;
  return kind == fmi2Terminated ? fmi2OK : fmi2Discard;
}

/* ---- what this plant does not have ---- */
#define NO_VARIABLES(Type)                                                                                                  \
  EXPORT fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2##Type value[]) {           \
    (void)vr, (void)value;                                                                                                  \
    return told(c, n ? "fmi2Get" #Type ": the plant has no variables of this type" : NULL);                                  \
  }                                                                                                                         \
  EXPORT fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2##Type value[]) {     \
    (void)vr, (void)value;                                                                                                  \
    return told(c, n ? "fmi2Set" #Type ": the plant has no variables of this type" : NULL);                                  \
  }
NO_VARIABLES(Integer)
NO_VARIABLES(Boolean)
NO_VARIABLES(String)

#define NO_STATUS(function, type)                                                            \
  EXPORT fmi2Status function(fmi2Component c, const fmi2StatusKind kind, type *value) {      \
    (void)c, (void)kind, (void)value;                                                        \
    return fmi2Discard;                                                                      \
  }
NO_STATUS(fmi2GetStatus, fmi2Status)
NO_STATUS(fmi2GetIntegerStatus, fmi2Integer)
NO_STATUS(fmi2GetStringStatus, fmi2String)

EXPORT fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                               const fmi2ValueReference known[], size_t knowns, const fmi2Real seed[],
                                               fmi2Real value[]) {
  (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)seed, (void)value;
  return told(c, "fmi2GetDirectionalDerivative: not provided");
}

EXPORT fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                               const fmi2Integer order[], fmi2Real value[]) {
  (void)vr, (void)n, (void)order, (void)value;
  return told(c, "fmi2GetRealOutputDerivatives: not provided");
}

EXPORT fmi2Status fmi2CancelStep(fmi2Component c) { return told(c, "fmi2CancelStep: steps are never pending"); }
