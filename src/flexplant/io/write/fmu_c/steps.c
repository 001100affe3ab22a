
/* ---- what both versions of the interface do; a text that is not NULL says what is wrong ---- */
typedef struct {
  State now;
  double step; /* the one that the transition belongs to, 0: none yet */
  Transition to;
} Plant;

/* inputs first, then outputs */
static double channel(const State *now, size_t i) { return i < INPUTS ? now->input[i] : output(now, (int)(i - INPUTS)); }

static void set_input(State *now, size_t i, double value) {
  now->input[i] = value;
  now->slope[i] = 0;
}

static const char *enter_phase(State *now, Phase before, Phase next) {
  if (now->phase != before) return "called out of order: instantiate, enter and exit initialization, step, terminate, reset";
  now->phase = next;
  return NULL;
}

/* A continuous plant takes a step of any size exactly; its transition is kept while the size stays within the last digits
   of time. A sampled plant takes whole numbers of samples, with the inputs held. */
static const char *do_step(Plant *plant, double time, double h) {
  State *now = &plant->now;
  bool sloped = false;
  int steps = 1;
  if (now->phase != RUNNING) return "a step needs a running simulation: exit initialization first, reset after termination";
  if (!(h >= 0 && h <= DBL_MAX)) return "the communication step must be a finite number of seconds, not negative";
  if (SAMPLED) {
    const double samples = h / SAMPLE_TIME;
    if (samples > 1e9) return "the communication step is longer than 1e9 samples";
    steps = (int)(samples + 0.5);
    if (magnitude(samples - steps) > 1e-6)
      return "the communication step must be a whole multiple of the plant's sample time of " SAMPLE_TIME_TEXT " s";
  }
  for (int j = 0; j < INPUTS; j++) sloped = sloped || now->slope[j] != 0;
  if (h > 0 && steps > 0) {
    const bool known = plant->step > 0 && magnitude(h - plant->step) <= 4 * DBL_EPSILON * (magnitude(time) + h);
    if (!known && !(SAMPLED && plant->step > 0)) {
      prepare(&plant->to, h);
      plant->step = h;
    }
    for (int i = 0; i < steps; i++) advance(now, &plant->to, sloped);
    for (int j = 0; j < INPUTS; j++) now->input[j] += now->slope[j] * h;
  }
  now->time = time + h;
  return NULL;
}

/* Saved states are plain copies, so they are serialized as bytes. */
static const char *copy_state(void *to, const void *from, size_t size) {
  if (!to || !from) return "no saved state was given, or there is no memory for one";
  if (size != sizeof(State)) return "the serialized state has another size than this plant's";
  memcpy(to, from, size);
  return NULL;
}
