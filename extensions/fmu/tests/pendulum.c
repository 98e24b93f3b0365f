/* A pendulum as an FMU for model exchange, FMI 2.0 or (-DFMI3) FMI 3.0:
 *   angle' = rate,  rate' = -(gravity / length) sin(angle) - damping rate + torque,
 *   height = -length cos(angle).
 * Value references are indices of `v`. The GUID or token names faults and variants of the model:
 *   error, discard: the rates fail where the angle exceeds 1, and say so;  hangs: they do not return
 *   unready: initialization is discarded;  endless: an event has no end
 *   dead, stuck: the library aborts or does not return when it is initialized
 *   timed: torque (1 + .3 sin(t + 1));  kinked: - |rate| beside - damping rate
 *   nodd: directional derivatives fail;  scaled: one of them is 10 % off
 *   event: beyond an angle of .5, after an event, the damping is doubled;  jump: it sets rate = 0
 *   memory: once doubled, the damping is normal again only below an angle of .1
 *   steps: the torque changes only at events
 * A call outside of its mode (states: continuous time; the end of an event: event mode) is an error.
 * `links`, an integer or enumeration of value reference 10, divides gravity. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { ANGLE, RATE, TORQUE, GRAVITY, LENGTH, DAMPING, D_ANGLE, D_RATE, HEIGHT, SIZE };
typedef struct {
    double v[SIZE], time;
    const char *token;
    int damped, ready, links, jumped, in_event;
    void (*log)(); /* of FMI 2.0 or 3.0 */
} Model;

static int is(const Model *m, const char *fault) { return strstr(m->token, fault) != NULL; }

static void start(Model *m)
{
    memset(m->v, 0, sizeof m->v);
    m->v[GRAVITY] = 9.81, m->v[LENGTH] = 2.0, m->v[DAMPING] = 0.5;
}

static int evaluate(Model *m)
{
    double *v = m->v, damping = v[DAMPING] * (m->damped ? 2 : 1);
    double torque = v[TORQUE] * (is(m, "timed") ? 1 + .3 * sin(m->time + 1) : 1);
    v[D_ANGLE] = v[RATE];
    v[D_RATE] = -v[GRAVITY] / m->links / v[LENGTH] * sin(v[ANGLE]) - damping * v[RATE] + torque;
    if (is(m, "kinked")) v[D_RATE] -= fabs(v[RATE]);
    v[HEIGHT] = -v[LENGTH] * cos(v[ANGLE]);
    while (is(m, "hangs") && v[ANGLE] > 1) ;
    int status = v[ANGLE] > 1 ? is(m, "error") ? 3 : is(m, "discard") ? 2 : 0 : 0;
#ifdef FMI3
    if (status && m->log) m->log(NULL, status, "", "fallen over");
#else
    if (status && m->log) m->log(NULL, "", status, "", "fallen over");
#endif
    return status;
}

/* Derivative of all variables along d. */
static void differentiate(const Model *m, double *d)
{
    const double *v = m->v;
    double s = sin(v[ANGLE]), c = cos(v[ANGLE]), g = v[GRAVITY], l = v[LENGTH];
    double scale = is(m, "scaled") ? 1.1 : 1;
    d[D_ANGLE] = d[RATE];
    d[D_RATE] = -scale * g / l * c * d[ANGLE] - s / l * d[GRAVITY] + g / (l * l) * s * d[LENGTH]
                - v[DAMPING] * d[RATE] - v[RATE] * d[DAMPING] + d[TORQUE];
    d[HEIGHT] = l * s * d[ANGLE] - c * d[LENGTH];
}

static int get(Model *m, const unsigned *r, size_t n, double *x)
{
    int status = evaluate(m);
    for (size_t i = 0; i < n; i++) x[i] = m->v[r[i]];
    return status;
}

/* The parameters and the Boolean `moon` are fixed when the initialization ends. */
static int set(Model *m, const unsigned *r, size_t n, const double *x)
{
    for (size_t i = 0; i < n; i++)
        if (m->ready && (r[i] > TORQUE || (is(m, "steps") && !m->in_event))) return 3;
    for (size_t i = 0; i < n; i++) m->v[r[i]] = x[i];
    return 0;
}

static int set_moon(Model *m, int on)
{
    m->v[GRAVITY] = on ? 1.62 : 9.81;
    return m->ready ? 3 : 0;
}

static int set_links(Model *m, int links)
{
    m->links = links;
    return m->ready ? 3 : 0;
}

static int end_initialization(Model *m)
{
    m->ready = m->in_event = 1;
    return is(m, "unready") ? 2 : 0;
}

static int set_states(Model *m, const double *x)
{
    memcpy(m->v, x, 16);
    return m->in_event ? 3 : 0;
}

static int enter(Model *m, int event) { m->in_event = event; return 0; }

static int along(Model *m, const unsigned *z, size_t nz, const unsigned *k, size_t nk,
                 const double *seed, double *sensitivity)
{
    double d[SIZE] = {0};
    for (size_t i = 0; i < nk; i++) d[k[i]] = seed[i];
    differentiate(m, d);
    for (size_t i = 0; i < nz; i++) sensitivity[i] = d[z[i]];
    return is(m, "nodd") ? 3 : 0;
}

static int rates(Model *m, double *x)
{
    int status = evaluate(m);
    memcpy(x, m->v + D_ANGLE, 16);
    return status;
}

/* The event: angle = .5, or .1 with memory. */
static double beyond(const Model *m)
{
    return m->v[ANGLE] - (is(m, "memory") && m->damped ? .1 : .5);
}

static int happen(Model *m)
{
    m->damped = is(m, "event") && beyond(m) > 0;
    m->jumped = m->damped && is(m, "jump");
    if (m->jumped) m->v[RATE] = 0;
    if (is(m, "dead")) abort();
    while (is(m, "stuck")) ;
    return m->in_event ? 0 : 3;
}

static Model *make(const char *token, void *log)
{
    Model *m = malloc(sizeof *m);
    start(m);
    m->token = strdup(token);
    m->time = m->damped = m->ready = m->in_event = 0;
    m->log = log;
    m->links = 1;
    return m;
}

#define NOTHING(name) int name(void *c) { (void)c; return 0; }
#ifdef FMI3
const char *fmi3GetVersion(void) { return "3.0"; }
void *fmi3InstantiateModelExchange(const char *n, const char *t, const char *r, int v, int l,
                                   void *e, void *f) { return make(t, f); }
void fmi3FreeInstance(void *c) { free(c); }
int fmi3SetDebugLogging(void *c, int l, size_t n, const char **s) { return 0; }
int fmi3EnterInitializationMode(void *c, int d, double t, double s, int e, double p) { return 0; }
int fmi3ExitInitializationMode(void *c) { return end_initialization(c); }
int fmi3EnterContinuousTimeMode(void *c) { return enter(c, 0); }
int fmi3EnterEventMode(void *c) { return enter(c, 1); }
NOTHING(fmi3Terminate)
int fmi3Reset(void *c) { start(c); return 0; }
int fmi3SetTime(void *c, double t) { ((Model *)c)->time = t; return 0; }
int fmi3GetFloat64(void *c, const unsigned *r, size_t n, double *x, size_t m) { return get(c, r, n, x); }
int fmi3SetFloat64(void *c, const unsigned *r, size_t n, const double *x, size_t m) { return set(c, r, n, x); }
#define EMPTY(type) \
    int fmi3Get##type(void *c, const unsigned *r, size_t n, void *x, size_t m) { return 0; } \
    int fmi3Set##type(void *c, const unsigned *r, size_t n, const void *x, size_t m) { return 0; }
EMPTY(Float32) EMPTY(Int8) EMPTY(UInt8) EMPTY(Int16) EMPTY(UInt16) EMPTY(UInt32)
EMPTY(UInt64) EMPTY(String)
int fmi3SetInt32(void *c, const unsigned *r, size_t n, const int *x, size_t m) { return set_links(c, x[0]); }
int fmi3SetInt64(void *c, const unsigned *r, size_t n, const long long *x, size_t m) { return set_links(c, x[0]); }
int fmi3SetBoolean(void *c, const unsigned *r, size_t n, const _Bool *x, size_t m) { return set_moon(c, x[0]); }
int fmi3UpdateDiscreteStates(void *c, char *a, char *b, char *d, char *e, char *f, double *t)
{ *a = *b = *d = *e = *f = 0; *a = is(c, "endless"); *t = 0.0; int status = happen(c); *e = ((Model *)c)->jumped; return status; }
int fmi3GetEventIndicators(void *c, double *x, size_t n) { x[0] = beyond(c); return 0; }
int fmi3CompletedIntegratorStep(void *c, int n, int *a, int *b) { *a = *b = 0; return 0; }
int fmi3SetContinuousStates(void *c, const double *x, size_t n) { return set_states(c, x); }
int fmi3GetContinuousStates(void *c, double *x, size_t n) { memcpy(x, ((Model *)c)->v, 16); return 0; }
int fmi3GetContinuousStateDerivatives(void *c, double *x, size_t n)
{ return rates(c, x); }
int fmi3GetDirectionalDerivative(void *c, const unsigned *z, size_t nz, const unsigned *k, size_t nk,
                                 const double *seed, size_t ns, double *out, size_t no)
{ return along(c, z, nz, k, nk, seed, out); }
#else
const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
void *fmi2Instantiate(const char *n, int t, const char *g, const char *r, void *f, int v, int l)
{ return t == 0 ? make(g, *(void **)f) : NULL; } /* 0 is model exchange */
void fmi2FreeInstance(void *c) { free(c); }
int fmi2SetDebugLogging(void *c, int l, size_t n, const char **s) { return 0; }
int fmi2SetupExperiment(void *c, int d, double t, double s, int e, double p) { return 0; }
NOTHING(fmi2EnterInitializationMode)
int fmi2ExitInitializationMode(void *c) { return end_initialization(c); }
int fmi2EnterContinuousTimeMode(void *c) { return enter(c, 0); }
int fmi2EnterEventMode(void *c) { return enter(c, 1); }
NOTHING(fmi2Terminate)
int fmi2Reset(void *c) { start(c); return 0; }
int fmi2SetTime(void *c, double t) { ((Model *)c)->time = t; return 0; }
int fmi2GetReal(void *c, const unsigned *r, size_t n, double *x) { return get(c, r, n, x); }
int fmi2SetReal(void *c, const unsigned *r, size_t n, const double *x) { return set(c, r, n, x); }
#define EMPTY(type) \
    int fmi2Get##type(void *c, const unsigned *r, size_t n, void *x) { return 0; } \
    int fmi2Set##type(void *c, const unsigned *r, size_t n, const void *x) { return 0; }
EMPTY(String)
int fmi2SetInteger(void *c, const unsigned *r, size_t n, const int *x) { return set_links(c, x[0]); }
int fmi2SetBoolean(void *c, const unsigned *r, size_t n, const int *x) { return set_moon(c, x[0]); }
int fmi2NewDiscreteStates(void *c, void *info) { memset(info, 0, 32); *(int *)info = is(c, "endless"); int status = happen(c); ((int *)info)[3] = ((Model *)c)->jumped; return status; }
int fmi2CompletedIntegratorStep(void *c, int n, int *a, int *b) { *a = *b = 0; return 0; }
int fmi2SetContinuousStates(void *c, const double *x, size_t n) { return set_states(c, x); }
int fmi2GetContinuousStates(void *c, double *x, size_t n) { memcpy(x, ((Model *)c)->v, 16); return 0; }
int fmi2GetDerivatives(void *c, double *x, size_t n)
{ return rates(c, x); }
int fmi2GetEventIndicators(void *c, double *x, size_t n) { x[0] = beyond(c); return 0; }
int fmi2GetNominalsOfContinuousStates(void *c, double *x, size_t n) { x[0] = x[1] = 1.0; return 0; }
int fmi2GetDirectionalDerivative(void *c, const unsigned *z, size_t nz, const unsigned *k, size_t nk,
                                 const double *seed, double *out) { return along(c, z, nz, k, nk, seed, out); }
#endif
