/* The functions of FMI 2.0 for one model, all on units. Declarations follow the standard, whose header files are not needed. */
#include "unit.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#ifdef FMI2_FUNCTION_PREFIX
#define JOIN(a, b) a##b
#define NAMED(prefix, name) JOIN(prefix, name)
#define FMI(name) NAMED(FMI2_FUNCTION_PREFIX, name)
#else
#define FMI(name) name
#endif

typedef void *instance;
typedef unsigned reference;
typedef int status, boolean;

typedef struct {
    void (*log)(void *environment, const char *instance, status s, const char *category, const char *message, ...);
    void *(*allocate)(size_t n, size_t size);
    void (*release)(void *memory);
    void (*finished)(void *environment, status s);
    void *environment;
} callbacks;

typedef struct {
    boolean again, terminate, nominals, states, next_defined;
    double next;
} event_info;

enum { MODEL_EXCHANGE, CO_SIMULATION }; /* values of the type of an instance */
enum { ALL_MODES = (1 << TERMINATED) - 1, ANY = ALL_MODES | 1 << TERMINATED };
#define ONLY(mode) (1u << (mode))

/* Refuses null pointers, and calls in a state in which the standard forbids them. */
#define BEGIN(call, modes) \
    unit *const x = (unit *)of; \
    if (!x || unit_in(x, call, modes)) return UNIT_ERROR

static void log_text(unit *x, int s, const char *text)
{
    const callbacks *const to = x->callback;
    if (to && to->log)
        to->log(to->environment, x->instance ? x->instance : "", s,
            s == UNIT_WARNING ? "logStatusWarning" : s == UNIT_DISCARD ? "logStatusDiscard" : "logStatusError", "%s", text);
}

static status lacks(instance of, const char *what)
{
    return of ? unit_say((unit *)of, UNIT_ERROR, "%s: this FMU has no such capability", what) : UNIT_ERROR;
}

/* ---- Instances. ---- */

EXPORT const char *FMI(fmi2GetTypesPlatform)(void) { return "default"; }

EXPORT const char *FMI(fmi2GetVersion)(void) { return "2.0"; }

EXPORT status FMI(fmi2SetDebugLogging)(instance of, boolean on, size_t n, const char *const categories[])
{
    (void)on, (void)n, (void)categories; /* errors and warnings are always logged, and nothing else is */
    return of ? UNIT_OK : UNIT_ERROR;
}

EXPORT instance FMI(fmi2Instantiate)(const char *name, int type, const char *guid, const char *resources, const callbacks *given,
    boolean visible, boolean logging)
{
    (void)resources, (void)visible, (void)logging;
    unit none = {.callback = (void *)(uintptr_t)given, .log = log_text};
    if (!guid || strcmp(guid, ordernm_unit_model.token)) {
        unit_say(&none, UNIT_ERROR, "the GUID is %s, expected %s", guid ? guid : "a null pointer", ordernm_unit_model.token);
        return 0;
    }
    return unit_new(type == CO_SIMULATION, name, log_text, given ? given->environment : 0, none.callback);
}

EXPORT void FMI(fmi2FreeInstance)(instance of) { unit_free((unit *)of); }

EXPORT status FMI(fmi2SetupExperiment)(instance of, boolean tolerance_defined, double tolerance, double start, boolean stop_defined,
    double stop)
{
    BEGIN("fmi2SetupExperiment", ONLY(INSTANTIATED));
    const int found = unit_start(x, start, tolerance_defined ? tolerance : x->model->rtol, stop_defined ? stop : INFINITY);
    *x->mode = INSTANTIATED;
    return found;
}

EXPORT status FMI(fmi2EnterInitializationMode)(instance of)
{
    BEGIN("fmi2EnterInitializationMode", ONLY(INSTANTIATED));
    *x->mode = INITIALIZING;
    return UNIT_OK;
}

EXPORT status FMI(fmi2ExitInitializationMode)(instance of)
{
    BEGIN("fmi2ExitInitializationMode", ONLY(INITIALIZING));
    return unit_started(x);
}

EXPORT status FMI(fmi2Terminate)(instance of)
{
    BEGIN("fmi2Terminate", ONLY(EVENT_MODE) | ONLY(CONTINUOUS_TIME) | ONLY(STEP_MODE));
    *x->mode = TERMINATED;
    return UNIT_OK;
}

EXPORT status FMI(fmi2Reset)(instance of)
{
    if (!of) return UNIT_ERROR;
    unit_reset((unit *)of);
    return UNIT_OK;
}

/* ---- Variables: all are of type Real. ---- */

EXPORT status FMI(fmi2GetReal)(instance of, const reference variables[], size_t n, double values[])
{
    BEGIN("fmi2GetReal", ANY);
    return unit_get(x, variables, n, values);
}

EXPORT status FMI(fmi2SetReal)(instance of, const reference variables[], size_t n, const double values[])
{
    BEGIN("fmi2SetReal", ALL_MODES);
    return unit_set(x, variables, n, values);
}

/* Functions for variables of other types; a call with no variables is allowed. */
#define OTHER_TYPE(Type, type) \
    EXPORT status FMI(fmi2Get##Type)(instance of, const reference variables[], size_t n, type values[]) \
    { \
        (void)variables, (void)values; \
        return of && !n ? UNIT_OK : lacks(of, "variables of type " #Type); \
    } \
    EXPORT status FMI(fmi2Set##Type)(instance of, const reference variables[], size_t n, const type values[]) \
    { \
        (void)variables, (void)values; \
        return of && !n ? UNIT_OK : lacks(of, "variables of type " #Type); \
    }
typedef const char *text;
OTHER_TYPE(Integer, int)
OTHER_TYPE(Boolean, boolean)
OTHER_TYPE(String, text)

/* ---- Saved states. ---- */

EXPORT status FMI(fmi2GetFMUstate)(instance of, void **state)
{
    BEGIN("fmi2GetFMUstate", ANY);
    return unit_save(x, state);
}

EXPORT status FMI(fmi2SetFMUstate)(instance of, void *state)
{
    BEGIN("fmi2SetFMUstate", ANY);
    return unit_restore(x, state);
}

EXPORT status FMI(fmi2FreeFMUstate)(instance of, void **state)
{
    if (!of) return UNIT_ERROR;
    if (state) free(*state), *state = 0;
    return UNIT_OK;
}

EXPORT status FMI(fmi2SerializedFMUstateSize)(instance of, void *state, size_t *size)
{
    BEGIN("fmi2SerializedFMUstateSize", ANY);
    (void)state;
    *size = unit_serialized_bytes(x);
    return UNIT_OK;
}

EXPORT status FMI(fmi2SerializeFMUstate)(instance of, void *state, char bytes[], size_t size)
{
    BEGIN("fmi2SerializeFMUstate", ANY);
    return unit_write(x, state, (unsigned char *)bytes, size);
}

EXPORT status FMI(fmi2DeSerializeFMUstate)(instance of, const char bytes[], size_t size, void **state)
{
    BEGIN("fmi2DeSerializeFMUstate", ANY);
    return unit_read(x, (const unsigned char *)bytes, size, state);
}

/* ---- Derivatives. ---- */

EXPORT status FMI(fmi2GetDirectionalDerivative)(instance of, const reference unknowns[], size_t nunknowns, const reference knowns[],
    size_t nknowns, const double seed[], double sensitivity[])
{
    BEGIN("fmi2GetDirectionalDerivative", ANY & ~ONLY(INSTANTIATED));
    return unit_along(x, unknowns, nunknowns, knowns, nknowns, seed, sensitivity);
}

/* ---- Model Exchange. ---- */

EXPORT status FMI(fmi2EnterEventMode)(instance of)
{
    BEGIN("fmi2EnterEventMode", ONLY(EVENT_MODE) | ONLY(CONTINUOUS_TIME));
    *x->mode = EVENT_MODE;
    return UNIT_OK;
}

EXPORT status FMI(fmi2NewDiscreteStates)(instance of, event_info *info)
{
    BEGIN("fmi2NewDiscreteStates", ONLY(EVENT_MODE));
    memset(info, 0, sizeof *info);
    const status found = unit_events(x, &info->next);
    info->next_defined = isfinite(info->next) != 0;
    return found;
}

EXPORT status FMI(fmi2EnterContinuousTimeMode)(instance of)
{
    BEGIN("fmi2EnterContinuousTimeMode", ONLY(EVENT_MODE));
    *x->mode = CONTINUOUS_TIME;
    return UNIT_OK;
}

EXPORT status FMI(fmi2CompletedIntegratorStep)(instance of, boolean no_restore, boolean *event, boolean *terminate)
{
    BEGIN("fmi2CompletedIntegratorStep", ONLY(CONTINUOUS_TIME));
    (void)no_restore;
    *event = *terminate = 0;
    return UNIT_OK;
}

EXPORT status FMI(fmi2SetTime)(instance of, double time)
{
    BEGIN("fmi2SetTime", ONLY(EVENT_MODE) | ONLY(CONTINUOUS_TIME));
    return unit_set_time(x, time);
}

EXPORT status FMI(fmi2SetContinuousStates)(instance of, const double states[], size_t n)
{
    BEGIN("fmi2SetContinuousStates", ONLY(EVENT_MODE) | ONLY(CONTINUOUS_TIME));
    return unit_set_states(x, states, n);
}

EXPORT status FMI(fmi2GetContinuousStates)(instance of, double states[], size_t n)
{
    BEGIN("fmi2GetContinuousStates", ANY & ~ONLY(INSTANTIATED));
    return unit_get_states(x, states, n);
}

EXPORT status FMI(fmi2GetDerivatives)(instance of, double derivatives[], size_t n)
{
    BEGIN("fmi2GetDerivatives", ANY & ~ONLY(INSTANTIATED));
    return unit_get_rates(x, derivatives, n);
}

EXPORT status FMI(fmi2GetEventIndicators)(instance of, double indicators[], size_t n)
{
    BEGIN("fmi2GetEventIndicators", ANY & ~ONLY(INSTANTIATED));
    return unit_get_indicators(x, indicators, n);
}

EXPORT status FMI(fmi2GetNominalsOfContinuousStates)(instance of, double nominals[], size_t n)
{
    BEGIN("fmi2GetNominalsOfContinuousStates", ANY & ~ONLY(INSTANTIATED));
    const size_t wanted = (size_t)(x->nfq + x->nfu);
    if (n != wanted) return unit_say(x, UNIT_ERROR, "an array has %zu entries, expected %zu, one for each continuous state", n, wanted);
    for (size_t i = 0; i < n; ++i) nominals[i] = 1.0;
    return UNIT_OK;
}

/* ---- Co-Simulation. ---- */

EXPORT status FMI(fmi2DoStep)(instance of, double t, double h, boolean no_restore)
{
    BEGIN("fmi2DoStep", ONLY(STEP_MODE));
    (void)no_restore;
    return unit_step(x, t, h);
}

/* Functions that this FMU does not have, by their arguments. */
#define LACKING(name, ...) \
    EXPORT status FMI(name)(instance of, __VA_ARGS__) { return lacks(of, #name); }
LACKING(fmi2SetRealInputDerivatives, const reference variables[], size_t n, const int orders[], const double values[])
LACKING(fmi2GetRealOutputDerivatives, const reference variables[], size_t n, const int orders[], double values[])
LACKING(fmi2GetStatus, int kind, status *value)
LACKING(fmi2GetIntegerStatus, int kind, int *value)
LACKING(fmi2GetStringStatus, int kind, text *value)
EXPORT status FMI(fmi2CancelStep)(instance of) { return lacks(of, "fmi2CancelStep"); }

enum { LAST_SUCCESSFUL_TIME = 2, TERMINATED_STATUS = 3 };

EXPORT status FMI(fmi2GetRealStatus)(instance of, int kind, double *value)
{
    BEGIN("fmi2GetRealStatus", ANY);
    if (kind != LAST_SUCCESSFUL_TIME) return lacks(of, "this kind of fmi2GetRealStatus");
    *value = *x->t;
    return UNIT_OK;
}

EXPORT status FMI(fmi2GetBooleanStatus)(instance of, int kind, boolean *value)
{
    BEGIN("fmi2GetBooleanStatus", ANY);
    if (kind != TERMINATED_STATUS) return lacks(of, "this kind of fmi2GetBooleanStatus");
    *value = 0;
    return UNIT_OK;
}
