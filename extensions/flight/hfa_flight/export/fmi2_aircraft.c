/* The aircraft as a functional mock-up unit of FMI 2.0, model exchange and co-simulation, around fmu_loop.

   fmu_settings.h says how many numbers there are. Value references: states, their rates, outputs, inputs. Co-simulation:
   Runge-Kutta of order 4, steps of FMU_LONGEST_STEP or less that divide the communication step, inputs held. A sampled policy
   (FMU_HELD commands) is computed every FMU_SAMPLE seconds from the first step on, and its commands are held. */
#include "fmu_settings.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* Types and functions of the standard, as its section 2 has them. */
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef void (*Logger)(void *, const char *, fmi2Status, const char *, const char *, ...);
typedef struct {
    Logger logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*step_finished)(void *, fmi2Status);
    void *environment;
} Callbacks;
typedef struct {
    int new_states_needed, terminate, nominals_changed, values_changed, next_event_defined;
    double next_event_time;
} EventInfo;

enum {
    STATE = 0,
    RATE = STATE + FMU_STATES,
    OUTPUT = RATE + FMU_STATES,
    INPUT = OUTPUT + FMU_OUTPUTS,
    END = INPUT + FMU_INPUTS,
    /* Of a sampled policy: held commands, memory, number of samples, time of the first one. */
    HELD = END,
    MEMORY = HELD + FMU_HELD,
    SAMPLES = MEMORY + FMU_MEMORY,
    BEGIN,
    ALL
};

typedef struct {
    double time, value[ALL];
    char name[64];
    Callbacks callbacks;
} Aircraft;

static void reset(Aircraft *a)
{
    static const double states[FMU_STATES] = FMU_STATE_STARTS, inputs[FMU_INPUTS] = FMU_INPUT_STARTS;
    a->time = 0.0;
    for (int i = 0; i < ALL; i++) a->value[i] = 0.0;
    for (int i = 0; i < FMU_STATES; i++) a->value[STATE + i] = states[i];
    for (int i = 0; i < FMU_INPUTS; i++) a->value[INPUT + i] = inputs[i];
#if FMU_HELD
    static const double held[FMU_HELD] = FMU_HELD_STARTS;
    for (int i = 0; i < FMU_HELD; i++) a->value[HELD + i] = held[i];
#endif
}

static fmi2Status refused(const Aircraft *a, const char *why)
{
    if (a->callbacks.logger)
        a->callbacks.logger(a->callbacks.environment, a->name, fmi2Error, "logStatusError", "%s", why);
    return fmi2Error;
}

/* The rates at the states y; the outputs too. */
static void rates_at(Aircraft *a, const double *y, double *dy)
{
    fmu_loop(y, a->value + INPUT, dy, a->value + OUTPUT);
}

static void step(Aircraft *a, double seconds)
{
    static const double share[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0, 2.0, 2.0, 1.0};
    double at[FMU_STATES], dx[FMU_STATES] = {0.0}, sum[FMU_STATES] = {0.0}, *x = a->value + STATE;
    for (int stage = 0; stage < 4; stage++) {
        for (int i = 0; i < FMU_STATES; i++) at[i] = x[i] + share[stage] * seconds * dx[i];
        rates_at(a, at, dx);
        for (int i = 0; i < FMU_STATES; i++) sum[i] += weight[stage] * dx[i];
    }
    for (int i = 0; i < FMU_STATES; i++) x[i] += seconds / 6.0 * sum[i];
}

/* Compute the samples that are due at a time, and return the time of the next one, or the end. */
static double sampled(Aircraft *a, double time, double end)
{
#if FMU_HELD
    if (a->value[SAMPLES] == 0.0) a->value[BEGIN] = time;
    double next = a->value[BEGIN] + a->value[SAMPLES] * FMU_SAMPLE;
    if (next <= time + 1e-9 * FMU_SAMPLE) {
        fmu_sample(a->value + STATE, a->value + INPUT, a->value + MEMORY, a->value + HELD);
        a->value[SAMPLES] += 1.0;
        next = a->value[BEGIN] + a->value[SAMPLES] * FMU_SAMPLE;
    }
    if (next < end - 1e-9 * FMU_SAMPLE) return next;
#endif
    (void)a, (void)time;
    return end;
}

/* Both kinds. */

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
EXPORT fmi2Status fmi2SetDebugLogging(void *c, int on, size_t n, const char *const categories[])
{
    (void)c, (void)on, (void)n, (void)categories;
    return fmi2OK;
}

EXPORT void *fmi2Instantiate(const char *name, fmi2Type type, const char *guid, const char *resources,
                             const Callbacks *callbacks, int visible, int logging)
{
    (void)type, (void)resources, (void)visible, (void)logging;
    Aircraft *a = calloc(1, sizeof *a);
    if (!a) return NULL;
    if (callbacks) a->callbacks = *callbacks;
    strncpy(a->name, name, sizeof a->name - 1);
    if (strcmp(guid, FMU_GUID) != 0) {
        refused(a, "the guid of modelDescription.xml is another one than that of the library");
        free(a);
        return NULL;
    }
    reset(a);
    return a;
}

EXPORT void fmi2FreeInstance(void *c) { free(c); }
EXPORT fmi2Status fmi2SetupExperiment(void *c, int has_tolerance, double tolerance, double start, int has_stop, double stop)
{
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    ((Aircraft *)c)->time = start;
    return fmi2OK;
}
EXPORT fmi2Status fmi2EnterInitializationMode(void *c) { (void)c; return fmi2OK; }
EXPORT fmi2Status fmi2ExitInitializationMode(void *c) { (void)c; return fmi2OK; }
EXPORT fmi2Status fmi2Terminate(void *c) { (void)c; return fmi2OK; }
EXPORT fmi2Status fmi2Reset(void *c) { reset(c); return fmi2OK; }

EXPORT fmi2Status fmi2GetReal(void *c, const unsigned *reference, size_t count, double *value)
{
    Aircraft *a = c;
    rates_at(a, a->value + STATE, a->value + RATE);
    for (size_t i = 0; i < count; i++) {
        if (reference[i] >= END) return refused(a, "unknown value reference");
        value[i] = a->value[reference[i]];
    }
    return fmi2OK;
}
EXPORT fmi2Status fmi2SetReal(void *c, const unsigned *reference, size_t count, const double *value)
{
    Aircraft *a = c;
    for (size_t i = 0; i < count; i++) {
        if (reference[i] >= END || (reference[i] >= RATE && reference[i] < INPUT))
            return refused(a, "a value that cannot be set");
        a->value[reference[i]] = value[i];
    }
    return fmi2OK;
}

/* There are no integers, booleans and texts. */
#define NONE(name, kind) \
    EXPORT fmi2Status name(void *c, const unsigned *reference, size_t count, kind *value) \
    { \
        (void)reference, (void)value; \
        return count == 0 ? fmi2OK : refused(c, "all values are real"); \
    }
NONE(fmi2GetInteger, int)
NONE(fmi2GetBoolean, int)
NONE(fmi2GetString, const char *)
NONE(fmi2SetInteger, const int)
NONE(fmi2SetBoolean, const int)
NONE(fmi2SetString, const char *const)

EXPORT fmi2Status fmi2GetFMUstate(void *c, void **state)
{
    if (!*state) *state = malloc(sizeof(Aircraft));
    if (!*state) return refused(c, "not enough memory");
    memcpy(*state, c, sizeof(Aircraft));
    return fmi2OK;
}
EXPORT fmi2Status fmi2SetFMUstate(void *c, const void *state)
{
    Aircraft *a = c;
    const Aircraft *kept = state;
    a->time = kept->time;
    memcpy(a->value, kept->value, sizeof a->value);
    return fmi2OK;
}
EXPORT fmi2Status fmi2FreeFMUstate(void *c, void **state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}
EXPORT fmi2Status fmi2SerializedFMUstateSize(void *c, void *state, size_t *size)
{
    (void)c, (void)state;
    *size = sizeof(Aircraft);
    return fmi2OK;
}
EXPORT fmi2Status fmi2SerializeFMUstate(void *c, void *state, char *bytes, size_t size)
{
    if (size < sizeof(Aircraft)) return refused(c, "the buffer is too small");
    memcpy(bytes, state, sizeof(Aircraft));
    return fmi2OK;
}
EXPORT fmi2Status fmi2DeSerializeFMUstate(void *c, const char *bytes, size_t size, void **state)
{
    if (size < sizeof(Aircraft)) return refused(c, "the buffer is too small");
    fmi2Status status = fmi2GetFMUstate(c, state);
    if (status == fmi2OK) memcpy(*state, bytes, sizeof(Aircraft));
    return status;
}
EXPORT fmi2Status fmi2GetDirectionalDerivative(void *c, const unsigned *unknown, size_t unknowns, const unsigned *known,
                                               size_t knowns, const double *seed, double *derivative)
{
    (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)seed, (void)derivative;
    return refused(c, "there are no directional derivatives");
}

/* Model exchange. */

EXPORT fmi2Status fmi2EnterEventMode(void *c) { (void)c; return fmi2OK; }
EXPORT fmi2Status fmi2EnterContinuousTimeMode(void *c) { (void)c; return fmi2OK; }
EXPORT fmi2Status fmi2NewDiscreteStates(void *c, EventInfo *info)
{
    (void)c;
    memset(info, 0, sizeof *info);
    return fmi2OK;
}
EXPORT fmi2Status fmi2CompletedIntegratorStep(void *c, int no_return, int *enter_event_mode, int *terminate)
{
    (void)c, (void)no_return;
    *enter_event_mode = *terminate = 0;
    return fmi2OK;
}
EXPORT fmi2Status fmi2SetTime(void *c, double time) { ((Aircraft *)c)->time = time; return fmi2OK; }
EXPORT fmi2Status fmi2SetContinuousStates(void *c, const double *x, size_t n)
{
    memcpy(((Aircraft *)c)->value + STATE, x, n * sizeof *x);
    return fmi2OK;
}
EXPORT fmi2Status fmi2GetContinuousStates(void *c, double *x, size_t n)
{
    memcpy(x, ((Aircraft *)c)->value + STATE, n * sizeof *x);
    return fmi2OK;
}
EXPORT fmi2Status fmi2GetDerivatives(void *c, double *dx, size_t n)
{
    Aircraft *a = c;
    rates_at(a, a->value + STATE, a->value + RATE);
    memcpy(dx, a->value + RATE, n * sizeof *dx);
    return fmi2OK;
}
EXPORT fmi2Status fmi2GetEventIndicators(void *c, double *z, size_t n) { (void)c, (void)z, (void)n; return fmi2OK; }
EXPORT fmi2Status fmi2GetNominalsOfContinuousStates(void *c, double *nominal, size_t n)
{
    static const double typical[FMU_STATES] = FMU_NOMINALS;
    (void)c;
    memcpy(nominal, typical, n * sizeof *nominal);
    return fmi2OK;
}

/* Co-simulation. */

EXPORT fmi2Status fmi2DoStep(void *c, double now, double seconds, int no_return)
{
    Aircraft *a = c;
    (void)no_return;
    if (!(seconds >= 0.0 && seconds < 1e9 * FMU_LONGEST_STEP))
        return refused(a, "the communication step is negative or too long");
    for (double begin = now, until; begin < now + seconds; begin = until) {
        until = sampled(a, begin, now + seconds);
        const double count = ceil((until - begin) / FMU_LONGEST_STEP - 1e-6);
        for (long i = 0; i < (long)count; i++) step(a, (until - begin) / count);
    }
    a->time = now + seconds;
    for (int i = 0; i < FMU_STATES; i++)
        if (!isfinite(a->value[STATE + i])) return refused(a, "the aircraft left every bound");
    return fmi2OK;
}
EXPORT fmi2Status fmi2CancelStep(void *c) { return refused(c, "steps are done at once"); }
EXPORT fmi2Status fmi2SetRealInputDerivatives(void *c, const unsigned *reference, size_t count, const int *order,
                                              const double *value)
{
    (void)reference, (void)count, (void)order, (void)value;
    return refused(c, "inputs are held during a step");
}
EXPORT fmi2Status fmi2GetRealOutputDerivatives(void *c, const unsigned *reference, size_t count, const int *order,
                                               double *value)
{
    (void)reference, (void)count, (void)order, (void)value;
    return refused(c, "there are no derivatives of outputs");
}
#define STATUS(name, kind) \
    EXPORT fmi2Status name(void *c, int which, kind *value) \
    { \
        (void)which, (void)value; \
        return refused(c, "steps are done at once"); \
    }
STATUS(fmi2GetStatus, fmi2Status)
STATUS(fmi2GetRealStatus, double)
STATUS(fmi2GetIntegerStatus, int)
STATUS(fmi2GetBooleanStatus, int)
STATUS(fmi2GetStringStatus, const char *)
