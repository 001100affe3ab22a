
/* ---- FMI 3.0: the public interface restated, and its functions ---- */
typedef void *fmi3Instance;
typedef void *fmi3InstanceEnvironment;
typedef void *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean;
typedef char fmi3Char;
typedef const fmi3Char *fmi3String;
typedef uint8_t fmi3Byte;
typedef const fmi3Byte *fmi3Binary;
typedef bool fmi3Clock;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef enum { fmi3Independent, fmi3Constant, fmi3Fixed, fmi3Tunable, fmi3Discrete, fmi3Dependent } fmi3DependencyKind;
typedef enum { fmi3IntervalNotYetKnown, fmi3IntervalUnchanged, fmi3IntervalChanged } fmi3IntervalQualifier;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3ClockUpdateCallback)(fmi3InstanceEnvironment);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean, fmi3Boolean, fmi3Boolean,
                                               fmi3Boolean, fmi3Boolean *, fmi3Float64 *);
typedef void (*fmi3LockPreemptionCallback)(void);
typedef void (*fmi3UnlockPreemptionCallback)(void);

typedef struct {
  Plant plant;
  fmi3InstanceEnvironment environment;
  fmi3LogMessageCallback log;
} Instance;

/* fmi3OK where there is no text; else the text goes to the importer's log */
static fmi3Status told(const Instance *m, const char *text) {
  if (m && !text) return fmi3OK;
  if (m && m->log) m->log(m->environment, fmi3Error, "logStatusError", text);
  return fmi3Error;
}

/* Value references: 0 time; with arrays 1 inputs, 2 outputs, 3 to 6 their names and units; else one each from 1 on. */
typedef struct {
  size_t first, count;
} Range;

static Range range_of(fmi3ValueReference reference, bool inputs_only) {
  Range none = {0, 0}, whole = {reference == 1 ? 0 : INPUTS, reference == 1 ? INPUTS : OUTPUTS}, one = {reference - 1, 1};
  if (reference == 0 || reference > (ARRAYS ? 2 : INPUTS + OUTPUTS)) return none;
  if (inputs_only && reference > (ARRAYS ? 1 : INPUTS)) return none;
  return ARRAYS ? whole : one;
}

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String categories[]) {
  (void)on, (void)n, (void)categories; /* there are only errors, and these are always told */
  return told(instance, NULL);
}

EXPORT fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                                fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
                                                const fmi3ValueReference required[], size_t n,
                                                fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                                fmi3IntermediateUpdateCallback update) {
  Instance *m;
  (void)name, (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)required, (void)n, (void)update;
  if (!token || strcmp(token, TOKEN) != 0) {
    if (log)
      log(environment, fmi3Error, "logStatusError",
          "fmi3InstantiateCoSimulation: this is another FMU than its modelDescription.xml tells");
    return NULL;
  }
  m = calloc(1, sizeof(Instance));
  if (!m) return NULL;
  m->environment = environment;
  m->log = log;
  return m;
}

EXPORT fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                                 fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                                 fmi3LogMessageCallback log) {
  (void)name, (void)token, (void)resources, (void)visible, (void)logging;
  if (log) log(environment, fmi3Error, "logStatusError", "fmi3InstantiateModelExchange: this FMU is for co-simulation");
  return NULL;
}

EXPORT fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                                      fmi3Boolean visible, fmi3Boolean logging,
                                                      fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                                      fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
                                                      fmi3UnlockPreemptionCallback unlock) {
  (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)update, (void)lock, (void)unlock;
  if (log) log(environment, fmi3Error, "logStatusError", "fmi3InstantiateScheduledExecution: this FMU is for co-simulation");
  return NULL;
}

EXPORT void fmi3FreeInstance(fmi3Instance instance) { free(instance); }

#define PHASE(function, before, next)                                                                     \
  EXPORT fmi3Status function(fmi3Instance instance) {                                                     \
    return told(instance, instance ? enter_phase(&((Instance *)instance)->plant.now, before, next) : NULL); \
  }
PHASE(fmi3ExitInitializationMode, INITIALIZING, RUNNING)
PHASE(fmi3Terminate, RUNNING, TERMINATED)

EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                              fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop) {
  Instance *m = instance;
  (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
  if (m) m->plant.now.time = start;
  return told(m, m ? enter_phase(&m->plant.now, INSTANTIATED, INITIALIZING) : NULL);
}

EXPORT fmi3Status fmi3Reset(fmi3Instance instance) {
  if (instance) memset(&((Instance *)instance)->plant.now, 0, sizeof(State));
  return told(instance, NULL);
}

EXPORT fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference references[], size_t n, fmi3Float64 values[],
                                 size_t count) {
  const Instance *m = instance;
  size_t at = 0;
  for (size_t i = 0; m && i < n; i++) {
    const Range range = range_of(references[i], false);
    const size_t size = references[i] ? range.count : 1;
    if (!size) return told(m, "fmi3GetFloat64: no variable of this type has this value reference");
    if (at + size > count) return told(m, "fmi3GetFloat64: there is room for fewer values than the variables have");
    if (!references[i]) values[at] = m->plant.now.time;
    for (size_t k = 0; k < range.count; k++) values[at + k] = channel(&m->plant.now, range.first + k);
    at += size;
  }
  return told(m, at == count || !m ? NULL : "fmi3GetFloat64: more values were asked for than the variables have");
}

EXPORT fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                                 const fmi3Float64 values[], size_t count) {
  Instance *m = instance;
  size_t at = 0;
  for (size_t i = 0; m && i < n; i++) {
    const Range range = range_of(references[i], true);
    if (!range.count) return told(m, "fmi3SetFloat64: no input has this value reference");
    if (at + range.count > count) return told(m, "fmi3SetFloat64: fewer values were given than the inputs have");
    for (size_t k = 0; k < range.count; k++) set_input(&m->plant.now, range.first + k, values[at + k]);
    at += range.count;
  }
  return told(m, at == count || !m ? NULL : "fmi3SetFloat64: more values were given than the inputs have");
}

EXPORT fmi3Status fmi3GetString(fmi3Instance instance, const fmi3ValueReference references[], size_t n, fmi3String values[],
                                size_t count) {
  static const char *const *const texts[] = {input_names, input_units, output_names, output_units};
  size_t at = 0;
  for (size_t i = 0; instance && i < n; i++) {
    const size_t list = references[i] - 3, size = list < 2 ? INPUTS : OUTPUTS;
    if (!ARRAYS || references[i] < 3 || list > 3) return told(instance, "fmi3GetString: no text has this value reference");
    if (at + size > count) return told(instance, "fmi3GetString: there is room for fewer texts than the variables have");
    for (size_t k = 0; k < size; k++) values[at++] = texts[list][k];
  }
  return told(instance, NULL);
}

EXPORT fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 step, fmi3Boolean no_going_back,
                             fmi3Boolean *event, fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *reached) {
  Instance *m = instance;
  const char *text = m ? do_step(&m->plant, time, step) : NULL;
  (void)no_going_back;
  if (event) *event = false;
  if (end) *end = false;
  if (early) *early = false;
  if (reached && m) *reached = m->plant.now.time;
  return told(m, text);
}

EXPORT fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *saved) {
  Instance *m = instance;
  if (m && saved && !*saved) *saved = calloc(1, sizeof(State));
  return told(m, m ? copy_state(saved ? *saved : NULL, &m->plant.now, sizeof(State)) : NULL);
}

EXPORT fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState saved) {
  Instance *m = instance;
  return told(m, m ? copy_state(&m->plant.now, saved, sizeof(State)) : NULL);
}

EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *saved) {
  if (saved) {
    free(*saved);
    *saved = NULL;
  }
  return told(instance, NULL);
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState saved, size_t *size) {
  (void)saved;
  *size = sizeof(State);
  return told(instance, NULL);
}

EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState saved, fmi3Byte bytes[], size_t size) {
  return told(instance, copy_state(bytes, saved, size));
}

EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size, fmi3FMUState *saved) {
  if (instance && saved && !*saved) *saved = calloc(1, sizeof(State));
  return told(instance, copy_state(saved ? *saved : NULL, bytes, size));
}

/* ---- what this plant does not have ---- */
#define NO_GETTER(Type)                                                                                                      \
  EXPORT fmi3Status fmi3Get##Type(fmi3Instance instance, const fmi3ValueReference references[], size_t n, fmi3##Type values[], \
                                  size_t count) {                                                                            \
    (void)references, (void)values, (void)count;                                                                             \
    return told(instance, n ? "fmi3Get" #Type ": the plant has no variables of this type" : NULL);                           \
  }
#define NO_SETTER(Type)                                                                                                      \
  EXPORT fmi3Status fmi3Set##Type(fmi3Instance instance, const fmi3ValueReference references[], size_t n,                    \
                                  const fmi3##Type values[], size_t count) {                                                 \
    (void)references, (void)values, (void)count;                                                                             \
    return told(instance, n ? "fmi3Set" #Type ": the plant has no variables of this type" : NULL);                           \
  }
#define NO_VARIABLES(Type) NO_GETTER(Type) NO_SETTER(Type)
NO_VARIABLES(Float32)
NO_VARIABLES(Int8)
NO_VARIABLES(UInt8)
NO_VARIABLES(Int16)
NO_VARIABLES(UInt16)
NO_VARIABLES(Int32)
NO_VARIABLES(UInt32)
NO_VARIABLES(Int64)
NO_VARIABLES(UInt64)
NO_VARIABLES(Boolean)
NO_SETTER(String)

/* Functions with these arguments beside the instance */
#define NONE0(f) \
  EXPORT fmi3Status f(fmi3Instance m) { return told(m, #f ": not provided"); }
#define NONE1(f, A) \
  EXPORT fmi3Status f(fmi3Instance m, A a) { return (void)a, told(m, #f ": not provided"); }
#define NONE2(f, A, B) \
  EXPORT fmi3Status f(fmi3Instance m, A a, B b) { return (void)a, (void)b, told(m, #f ": not provided"); }
#define NONE3(f, A, B, C) \
  EXPORT fmi3Status f(fmi3Instance m, A a, B b, C c) { return (void)a, (void)b, (void)c, told(m, #f ": not provided"); }
#define NONE4(f, A, B, C, D)                                     \
  EXPORT fmi3Status f(fmi3Instance m, A a, B b, C c, D d) {      \
    return (void)a, (void)b, (void)c, (void)d, told(m, #f ": not provided"); \
  }
#define NONE5(f, A, B, C, D, E)                                  \
  EXPORT fmi3Status f(fmi3Instance m, A a, B b, C c, D d, E e) { \
    return (void)a, (void)b, (void)c, (void)d, (void)e, told(m, #f ": not provided"); \
  }
#define NONE6(f, A, B, C, D, E, F)                                    \
  EXPORT fmi3Status f(fmi3Instance m, A a, B b, C c, D d, E e, F g) { \
    return (void)a, (void)b, (void)c, (void)d, (void)e, (void)g, told(m, #f ": not provided"); \
  }
#define NONE8(f, A, B, C, D, E, F, G, H)                                        \
  EXPORT fmi3Status f(fmi3Instance m, A a, B b, C c, D d, E e, F g, G h, H i) { \
    return (void)a, (void)b, (void)c, (void)d, (void)e, (void)g, (void)h, (void)i, told(m, #f ": not provided"); \
  }
typedef const fmi3ValueReference *References;
NONE5(fmi3GetBinary, References, size_t, size_t *, fmi3Binary *, size_t)
NONE5(fmi3SetBinary, References, size_t, const size_t *, const fmi3Binary *, size_t)
NONE3(fmi3GetClock, References, size_t, fmi3Clock *)
NONE3(fmi3SetClock, References, size_t, const fmi3Clock *)
NONE2(fmi3GetNumberOfVariableDependencies, fmi3ValueReference, size_t *)
NONE6(fmi3GetVariableDependencies, fmi3ValueReference, size_t *, fmi3ValueReference *, size_t *, fmi3DependencyKind *, size_t)
NONE8(fmi3GetDirectionalDerivative, References, size_t, References, size_t, const fmi3Float64 *, size_t, fmi3Float64 *, size_t)
NONE8(fmi3GetAdjointDerivative, References, size_t, References, size_t, const fmi3Float64 *, size_t, fmi3Float64 *, size_t)
NONE0(fmi3EnterEventMode)
NONE0(fmi3EnterStepMode)
NONE0(fmi3EnterConfigurationMode)
NONE0(fmi3ExitConfigurationMode)
NONE0(fmi3EnterContinuousTimeMode)
NONE0(fmi3EvaluateDiscreteStates)
NONE6(fmi3UpdateDiscreteStates, fmi3Boolean *, fmi3Boolean *, fmi3Boolean *, fmi3Boolean *, fmi3Boolean *, fmi3Float64 *)
NONE4(fmi3GetIntervalDecimal, References, size_t, fmi3Float64 *, fmi3IntervalQualifier *)
NONE5(fmi3GetIntervalFraction, References, size_t, fmi3UInt64 *, fmi3UInt64 *, fmi3IntervalQualifier *)
NONE3(fmi3GetShiftDecimal, References, size_t, fmi3Float64 *)
NONE4(fmi3GetShiftFraction, References, size_t, fmi3UInt64 *, fmi3UInt64 *)
NONE3(fmi3SetIntervalDecimal, References, size_t, const fmi3Float64 *)
NONE4(fmi3SetIntervalFraction, References, size_t, const fmi3UInt64 *, const fmi3UInt64 *)
NONE3(fmi3SetShiftDecimal, References, size_t, const fmi3Float64 *)
NONE4(fmi3SetShiftFraction, References, size_t, const fmi3UInt64 *, const fmi3UInt64 *)
NONE3(fmi3CompletedIntegratorStep, fmi3Boolean, fmi3Boolean *, fmi3Boolean *)
NONE1(fmi3SetTime, fmi3Float64)
NONE2(fmi3SetContinuousStates, const fmi3Float64 *, size_t)
NONE2(fmi3GetContinuousStates, fmi3Float64 *, size_t)
NONE2(fmi3GetContinuousStateDerivatives, fmi3Float64 *, size_t)
NONE2(fmi3GetNominalsOfContinuousStates, fmi3Float64 *, size_t)
NONE2(fmi3GetEventIndicators, fmi3Float64 *, size_t)
NONE1(fmi3GetNumberOfEventIndicators, size_t *)
NONE1(fmi3GetNumberOfContinuousStates, size_t *)
NONE5(fmi3GetOutputDerivatives, References, size_t, const fmi3Int32 *, fmi3Float64 *, size_t)
NONE2(fmi3ActivateModelPartition, fmi3ValueReference, fmi3Float64)
