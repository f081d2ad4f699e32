/* The functions of FMI 3.0 for one model, all on units. */
#include <stdbool.h>
#include <stdint.h>

typedef bool boolean;
typedef uint8_t byte;

#define NAME(name) JOINED(fmi3, name)
#ifdef FMI3_FUNCTION_PREFIX
#define PREFIX FMI3_FUNCTION_PREFIX
#endif
#define TOKEN_NAME "instantiation token"
#define COUNT , size_t nvalues
#define STATE FMUState
#define DESERIALIZE DeserializeFMUState
#define GET_RATES GetContinuousStateDerivatives
#define SET_STATES ONLY(CONTINUOUS_TIME)
#include "fmi.h"

typedef void log_message(void *environment, status s, const char *category, const char *message);

static void log_text(unit *x, int s, const char *words)
{
    log_message *const callback = (log_message *)(uintptr_t)x->callback;
    if (callback) callback(x->environment, s, category_of(s), words);
}

/* ---- Instances. ---- */

EXPORT const char *FMI(GetVersion)(void) { return "3.0"; }

EXPORT instance FMI(InstantiateModelExchange)(const char *name, const char *token, const char *resources, bool visible, bool logging,
    void *environment, log_message *log)
{
    (void)resources, (void)visible, (void)logging;
    return instantiate(name, token, 0, environment, (void *)(uintptr_t)log);
}

EXPORT instance FMI(InstantiateCoSimulation)(const char *name, const char *token, const char *resources, bool visible, bool logging,
    bool events, bool early, const reference required[], size_t n, void *environment, log_message *log, void *intermediate)
{
    (void)resources, (void)visible, (void)logging, (void)early, (void)required, (void)intermediate;
    unit *const x = instantiate(name, token, 1, environment, (void *)(uintptr_t)log);
    if (x && (events || n)) {
        lacks(x, events ? "eventModeUsed" : "requiredIntermediateVariables");
        unit_free(x);
        return 0;
    }
    return x;
}

EXPORT instance FMI(InstantiateScheduledExecution)(const char *name, const char *token, const char *resources, bool visible,
    bool logging, void *environment, log_message *log, void *clock, void *lock, void *unlock)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)clock, (void)lock, (void)unlock;
    unit none = {.environment = environment, .callback = (void *)(uintptr_t)log, .log = log_text};
    lacks(&none, "Scheduled Execution");
    return 0;
}

EXPORT status FMI(EnterInitializationMode)(instance of, bool tolerance_defined, double tolerance, double start, bool stop_defined,
    double stop)
{
    BEGIN(EnterInitializationMode, ONLY(INSTANTIATED));
    return unit_start(x, start, tolerance_defined ? tolerance : x->model->rtol, stop_defined ? stop : INFINITY);
}

EXPORT status FMI(EnterEventMode)(instance of)
{
    BEGIN(EnterEventMode, ONLY(CONTINUOUS_TIME));
    *x->mode = EVENT_MODE;
    return UNIT_OK;
}

/* ---- Variables: all are of type Float64. ---- */

EXPORT status FMI(GetFloat64)(instance of, const reference variables[], size_t n, double values[], size_t nvalues)
{
    BEGIN(GetFloat64, ANY);
    if (n != nvalues) return unit_say(x, UNIT_ERROR, "fmi3GetFloat64: there are %zu values for %zu scalar variables", nvalues, n);
    return unit_get(x, variables, n, values);
}

EXPORT status FMI(SetFloat64)(instance of, const reference variables[], size_t n, const double values[], size_t nvalues)
{
    BEGIN(SetFloat64, ALL_MODES);
    if (n != nvalues) return unit_say(x, UNIT_ERROR, "fmi3SetFloat64: there are %zu values for %zu scalar variables", nvalues, n);
    return unit_set(x, variables, n, values);
}

OTHER_TYPE(Float32, float)
OTHER_TYPE(Int8, int8_t)
OTHER_TYPE(UInt8, uint8_t)
OTHER_TYPE(Int16, int16_t)
OTHER_TYPE(UInt16, uint16_t)
OTHER_TYPE(Int32, int32_t)
OTHER_TYPE(UInt32, uint32_t)
OTHER_TYPE(Int64, int64_t)
OTHER_TYPE(UInt64, uint64_t)
OTHER_TYPE(Boolean, bool)
OTHER_TYPE(String, text)

EXPORT status FMI(GetBinary)(instance of, const reference variables[], size_t n, size_t sizes[], const uint8_t *values[], size_t nvalues)
{
    (void)variables, (void)sizes, (void)values, (void)nvalues;
    return of && !n ? UNIT_OK : lacks(of, "variables of type Binary");
}

EXPORT status FMI(SetBinary)(instance of, const reference variables[], size_t n, const size_t sizes[], const uint8_t *const values[],
    size_t nvalues)
{
    (void)variables, (void)sizes, (void)values, (void)nvalues;
    return of && !n ? UNIT_OK : lacks(of, "variables of type Binary");
}

EXPORT status FMI(GetClock)(instance of, const reference variables[], size_t n, bool values[])
{
    (void)variables, (void)values;
    return of && !n ? UNIT_OK : lacks(of, "clocks");
}

EXPORT status FMI(SetClock)(instance of, const reference variables[], size_t n, const bool values[])
{
    (void)variables, (void)values;
    return of && !n ? UNIT_OK : lacks(of, "clocks");
}

LACKING(GetNumberOfVariableDependencies, reference variable, size_t *n)
LACKING(GetVariableDependencies, reference dependent, size_t elements[], reference independents[], size_t of_independents[], int kinds[], size_t n)
LACKING(GetIntervalDecimal, const reference clocks[], size_t n, double intervals[], int qualifiers[])
LACKING(GetIntervalFraction, const reference clocks[], size_t n, uint64_t counters[], uint64_t resolutions[], int qualifiers[])
LACKING(GetShiftDecimal, const reference clocks[], size_t n, double shifts[])
LACKING(GetShiftFraction, const reference clocks[], size_t n, uint64_t counters[], uint64_t resolutions[])
LACKING(SetIntervalDecimal, const reference clocks[], size_t n, const double intervals[])
LACKING(SetIntervalFraction, const reference clocks[], size_t n, const uint64_t counters[], const uint64_t resolutions[])
LACKING(SetShiftDecimal, const reference clocks[], size_t n, const double shifts[])
LACKING(SetShiftFraction, const reference clocks[], size_t n, const uint64_t counters[], const uint64_t resolutions[])
LACKING(ActivateModelPartition, reference clock, double time)
LACKING(GetOutputDerivatives, const reference variables[], size_t n, const int32_t orders[], double values[], size_t nvalues)
LACKING_ALL(EnterConfigurationMode)
LACKING_ALL(ExitConfigurationMode)
LACKING_ALL(EnterStepMode)

/* ---- Derivatives. ---- */

static int scalars(unit *x, const char *call, size_t nknowns, size_t nseed, size_t nunknowns, size_t nresult)
{
    if (nknowns == nseed && nunknowns == nresult) return UNIT_OK;
    return unit_say(x, UNIT_ERROR, "%s: there are %zu entries of the seed for %zu scalar variables, and %zu derivatives for %zu", call, nseed,
        nknowns, nresult, nunknowns);
}

EXPORT status FMI(GetDirectionalDerivative)(instance of, const reference unknowns[], size_t nunknowns, const reference knowns[],
    size_t nknowns, const double seed[], size_t nseed, double sensitivity[], size_t nsensitivity)
{
    BEGIN(GetDirectionalDerivative, KNOWN);
    if (scalars(x, "fmi3GetDirectionalDerivative", nknowns, nseed, nunknowns, nsensitivity)) return UNIT_ERROR;
    return unit_along(x, unknowns, nunknowns, knowns, nknowns, seed, sensitivity);
}

EXPORT status FMI(GetAdjointDerivative)(instance of, const reference unknowns[], size_t nunknowns, const reference knowns[],
    size_t nknowns, const double seed[], size_t nseed, double sensitivity[], size_t nsensitivity)
{
    BEGIN(GetAdjointDerivative, KNOWN);
    if (scalars(x, "fmi3GetAdjointDerivative", nunknowns, nseed, nknowns, nsensitivity)) return UNIT_ERROR;
    return unit_adjoint(x, unknowns, nunknowns, knowns, nknowns, seed, sensitivity);
}

/* ---- Model Exchange. ---- */

EXPORT status FMI(EvaluateDiscreteStates)(instance of)
{
    BEGIN(EvaluateDiscreteStates, ONLY(INITIALIZING) | ONLY(EVENT_MODE));
    return unit_update(x);
}

EXPORT status FMI(UpdateDiscreteStates)(instance of, bool *again, bool *terminate, bool *nominals, bool *states, bool *next_defined,
    double *next)
{
    BEGIN(UpdateDiscreteStates, ONLY(EVENT_MODE));
    *again = *terminate = *nominals = *states = false;
    const status found = unit_events(x, next);
    *next_defined = isfinite(*next);
    return found;
}

EXPORT status FMI(GetNumberOfEventIndicators)(instance of, size_t *n)
{
    BEGIN(GetNumberOfEventIndicators, ANY);
    *n = (size_t)x->model->nindicators;
    return UNIT_OK;
}

EXPORT status FMI(GetNumberOfContinuousStates)(instance of, size_t *n)
{
    BEGIN(GetNumberOfContinuousStates, ANY);
    *n = (size_t)(x->nfq + x->nfu);
    return UNIT_OK;
}

/* ---- Co-Simulation. ---- */

EXPORT status FMI(DoStep)(instance of, double t, double h, bool no_restore, bool *event, bool *terminate, bool *early, double *last)
{
    BEGIN(DoStep, ONLY(STEP_MODE));
    (void)no_restore;
    *event = *terminate = *early = false;
    const int found = unit_step(x, t, h);
    *last = *x->t;
    return found;
}
