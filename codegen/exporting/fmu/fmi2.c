/* The functions of FMI 2.0 for one model, all on units. */
typedef int boolean;
typedef char byte;

#define NAME(name) JOINED(fmi2, name)
#ifdef FMI2_FUNCTION_PREFIX
#define PREFIX FMI2_FUNCTION_PREFIX
#endif
#define TOKEN_NAME "GUID"
#define COUNT
#define STATE FMUstate
#define DESERIALIZE DeSerializeFMUstate
#define GET_RATES GetDerivatives
#define SET_STATES (ONLY(EVENT_MODE) | ONLY(CONTINUOUS_TIME))
#include "fmi.h"

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

static void log_text(unit *x, int s, const char *words)
{
    const callbacks *const to = x->callback;
    if (to && to->log) to->log(to->environment, x->instance ? x->instance : "", s, category_of(s), "%s", words);
}

/* ---- Instances. ---- */

EXPORT const char *FMI(GetTypesPlatform)(void) { return "default"; }

EXPORT const char *FMI(GetVersion)(void) { return "2.0"; }

EXPORT instance FMI(Instantiate)(const char *name, int type, const char *guid, const char *resources, const callbacks *given,
    boolean visible, boolean logging)
{
    (void)resources, (void)visible, (void)logging;
    return instantiate(name, guid, type == CO_SIMULATION, given ? given->environment : 0, (void *)(uintptr_t)given);
}

EXPORT status FMI(SetupExperiment)(instance of, boolean tolerance_defined, double tolerance, double start, boolean stop_defined,
    double stop)
{
    BEGIN(SetupExperiment, ONLY(INSTANTIATED));
    const int found = unit_start(x, start, tolerance_defined ? tolerance : x->model->rtol, stop_defined ? stop : INFINITY);
    *x->mode = INSTANTIATED;
    return found;
}

EXPORT status FMI(EnterInitializationMode)(instance of)
{
    BEGIN(EnterInitializationMode, ONLY(INSTANTIATED));
    *x->mode = INITIALIZING;
    return UNIT_OK;
}

/* ---- Variables: all are of type Real. ---- */

EXPORT status FMI(GetReal)(instance of, const reference variables[], size_t n, double values[])
{
    BEGIN(GetReal, ANY);
    return unit_get(x, variables, n, values);
}

EXPORT status FMI(SetReal)(instance of, const reference variables[], size_t n, const double values[])
{
    BEGIN(SetReal, ALL_MODES);
    return unit_set(x, variables, n, values);
}

OTHER_TYPE(Integer, int)
OTHER_TYPE(Boolean, boolean)
OTHER_TYPE(String, text)

/* ---- Derivatives. ---- */

EXPORT status FMI(GetDirectionalDerivative)(instance of, const reference unknowns[], size_t nunknowns, const reference knowns[],
    size_t nknowns, const double seed[], double sensitivity[])
{
    BEGIN(GetDirectionalDerivative, KNOWN);
    return unit_along(x, unknowns, nunknowns, knowns, nknowns, seed, sensitivity);
}

/* ---- Model Exchange. ---- */

EXPORT status FMI(EnterEventMode)(instance of)
{
    BEGIN(EnterEventMode, ONLY(EVENT_MODE) | ONLY(CONTINUOUS_TIME));
    *x->mode = EVENT_MODE;
    return UNIT_OK;
}

EXPORT status FMI(NewDiscreteStates)(instance of, event_info *info)
{
    BEGIN(NewDiscreteStates, ONLY(EVENT_MODE));
    memset(info, 0, sizeof *info);
    const status found = unit_events(x, &info->next);
    info->next_defined = isfinite(info->next) != 0;
    return found;
}

/* ---- Co-Simulation. ---- */

EXPORT status FMI(DoStep)(instance of, double t, double h, boolean no_restore)
{
    BEGIN(DoStep, ONLY(STEP_MODE));
    (void)no_restore;
    return unit_step(x, t, h);
}

LACKING(SetRealInputDerivatives, const reference variables[], size_t n, const int orders[], const double values[])
LACKING(GetRealOutputDerivatives, const reference variables[], size_t n, const int orders[], double values[])
LACKING(GetStatus, int kind, status *value)
LACKING(GetIntegerStatus, int kind, int *value)
LACKING(GetStringStatus, int kind, text *value)
LACKING_ALL(CancelStep)

enum { LAST_SUCCESSFUL_TIME = 2, TERMINATED_STATUS = 3 };

EXPORT status FMI(GetRealStatus)(instance of, int kind, double *value)
{
    BEGIN(GetRealStatus, ANY);
    if (kind != LAST_SUCCESSFUL_TIME) return lacks(of, "this kind of fmi2GetRealStatus");
    *value = *x->t;
    return UNIT_OK;
}

EXPORT status FMI(GetBooleanStatus)(instance of, int kind, boolean *value)
{
    BEGIN(GetBooleanStatus, ANY);
    if (kind != TERMINATED_STATUS) return lacks(of, "this kind of fmi2GetBooleanStatus");
    *value = 0;
    return UNIT_OK;
}
