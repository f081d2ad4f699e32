/* The functions of FMI 3.0 for one model, all on units. Declarations follow the standard, whose header files are not needed. */
#include "unit.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#ifdef FMI3_FUNCTION_PREFIX
#define JOIN(a, b) a##b
#define NAMED(prefix, name) JOIN(prefix, name)
#define FMI(name) NAMED(FMI3_FUNCTION_PREFIX, name)
#else
#define FMI(name) name
#endif

typedef void *instance;
typedef uint32_t reference;
typedef int status;
typedef void log_message(void *environment, status s, const char *category, const char *message);

enum { ALL_MODES = (1 << TERMINATED) - 1, ANY = ALL_MODES | 1 << TERMINATED };
#define ONLY(mode) (1u << (mode))

/* Refuses null pointers, and calls in a state in which the standard forbids them. */
#define BEGIN(call, modes) \
    unit *const x = (unit *)of; \
    if (!x || unit_in(x, call, modes)) return UNIT_ERROR

static void log_text(unit *x, int s, const char *text)
{
    log_message *const callback = (log_message *)(uintptr_t)x->callback;
    if (callback) callback(x->environment, s, s == UNIT_WARNING ? "logStatusWarning" : s == UNIT_DISCARD ? "logStatusDiscard" : "logStatusError", text);
}

static unit *instantiate(const char *name, const char *token, int integrates, void *environment, log_message *log)
{
    unit none = {.environment = environment, .callback = (void *)(uintptr_t)log, .log = log_text};
    if (!token || strcmp(token, ordernm_unit_model.token)) {
        unit_say(&none, UNIT_ERROR, "the instantiation token is %s, expected %s", token ? token : "a null pointer", ordernm_unit_model.token);
        return 0;
    }
    return unit_new(integrates, name, log_text, environment, none.callback);
}

static status lacks(instance of, const char *what)
{
    return of ? unit_say((unit *)of, UNIT_ERROR, "%s: this FMU has no such capability", what) : UNIT_ERROR;
}

/* ---- Instances. ---- */

EXPORT const char *FMI(fmi3GetVersion)(void) { return "3.0"; }

EXPORT status FMI(fmi3SetDebugLogging)(instance of, bool on, size_t n, const char *const categories[])
{
    (void)on, (void)n, (void)categories; /* errors and warnings are always logged, and nothing else is */
    return of ? UNIT_OK : UNIT_ERROR;
}

EXPORT instance FMI(fmi3InstantiateModelExchange)(const char *name, const char *token, const char *resources, bool visible, bool logging,
    void *environment, log_message *log)
{
    (void)resources, (void)visible, (void)logging;
    return instantiate(name, token, 0, environment, log);
}

EXPORT instance FMI(fmi3InstantiateCoSimulation)(const char *name, const char *token, const char *resources, bool visible, bool logging,
    bool events, bool early, const reference required[], size_t n, void *environment, log_message *log, void *intermediate)
{
    (void)resources, (void)visible, (void)logging, (void)early, (void)required, (void)intermediate;
    unit *const x = instantiate(name, token, 1, environment, log);
    if (x && (events || n)) {
        lacks(x, events ? "eventModeUsed" : "requiredIntermediateVariables");
        unit_free(x);
        return 0;
    }
    return x;
}

EXPORT instance FMI(fmi3InstantiateScheduledExecution)(const char *name, const char *token, const char *resources, bool visible,
    bool logging, void *environment, log_message *log, void *clock, void *lock, void *unlock)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)clock, (void)lock, (void)unlock;
    unit none = {.environment = environment, .callback = (void *)(uintptr_t)log, .log = log_text};
    lacks(&none, "Scheduled Execution");
    return 0;
}

EXPORT void FMI(fmi3FreeInstance)(instance of) { unit_free((unit *)of); }

EXPORT status FMI(fmi3EnterInitializationMode)(instance of, bool tolerance_defined, double tolerance, double start, bool stop_defined,
    double stop)
{
    BEGIN("fmi3EnterInitializationMode", ONLY(INSTANTIATED));
    return unit_start(x, start, tolerance_defined ? tolerance : x->model->rtol, stop_defined ? stop : INFINITY);
}

EXPORT status FMI(fmi3ExitInitializationMode)(instance of)
{
    BEGIN("fmi3ExitInitializationMode", ONLY(INITIALIZING));
    return unit_started(x);
}

EXPORT status FMI(fmi3EnterEventMode)(instance of)
{
    BEGIN("fmi3EnterEventMode", ONLY(CONTINUOUS_TIME));
    *x->mode = EVENT_MODE;
    return UNIT_OK;
}

EXPORT status FMI(fmi3Terminate)(instance of)
{
    BEGIN("fmi3Terminate", ONLY(EVENT_MODE) | ONLY(CONTINUOUS_TIME) | ONLY(STEP_MODE));
    *x->mode = TERMINATED;
    return UNIT_OK;
}

EXPORT status FMI(fmi3Reset)(instance of)
{
    if (!of) return UNIT_ERROR;
    unit_reset((unit *)of);
    return UNIT_OK;
}

/* ---- Variables: all are of type Float64. ---- */

EXPORT status FMI(fmi3GetFloat64)(instance of, const reference variables[], size_t n, double values[], size_t nvalues)
{
    BEGIN("fmi3GetFloat64", ANY);
    if (n != nvalues) return unit_say(x, UNIT_ERROR, "fmi3GetFloat64: there are %zu values for %zu scalar variables", nvalues, n);
    return unit_get(x, variables, n, values);
}

EXPORT status FMI(fmi3SetFloat64)(instance of, const reference variables[], size_t n, const double values[], size_t nvalues)
{
    BEGIN("fmi3SetFloat64", ALL_MODES);
    if (n != nvalues) return unit_say(x, UNIT_ERROR, "fmi3SetFloat64: there are %zu values for %zu scalar variables", nvalues, n);
    return unit_set(x, variables, n, values);
}

/* Functions for variables of other types; a call with no variables is allowed. */
#define OTHER_TYPE(Type, type) \
    EXPORT status FMI(fmi3Get##Type)(instance of, const reference variables[], size_t n, type values[], size_t nvalues) \
    { \
        (void)variables, (void)values, (void)nvalues; \
        return of && !n ? UNIT_OK : lacks(of, "variables of type " #Type); \
    } \
    EXPORT status FMI(fmi3Set##Type)(instance of, const reference variables[], size_t n, const type values[], size_t nvalues) \
    { \
        (void)variables, (void)values, (void)nvalues; \
        return of && !n ? UNIT_OK : lacks(of, "variables of type " #Type); \
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
typedef const char *text;
OTHER_TYPE(String, text)

EXPORT status FMI(fmi3GetBinary)(instance of, const reference variables[], size_t n, size_t sizes[], const uint8_t *values[], size_t nvalues)
{
    (void)variables, (void)sizes, (void)values, (void)nvalues;
    return of && !n ? UNIT_OK : lacks(of, "variables of type Binary");
}

EXPORT status FMI(fmi3SetBinary)(instance of, const reference variables[], size_t n, const size_t sizes[], const uint8_t *const values[],
    size_t nvalues)
{
    (void)variables, (void)sizes, (void)values, (void)nvalues;
    return of && !n ? UNIT_OK : lacks(of, "variables of type Binary");
}

EXPORT status FMI(fmi3GetClock)(instance of, const reference variables[], size_t n, bool values[])
{
    (void)variables, (void)values;
    return of && !n ? UNIT_OK : lacks(of, "clocks");
}

EXPORT status FMI(fmi3SetClock)(instance of, const reference variables[], size_t n, const bool values[])
{
    (void)variables, (void)values;
    return of && !n ? UNIT_OK : lacks(of, "clocks");
}

/* Functions that this FMU does not have, by their arguments. */
#define LACKING(name, ...) \
    EXPORT status FMI(name)(instance of, __VA_ARGS__) { return lacks(of, #name); }
LACKING(fmi3GetNumberOfVariableDependencies, reference variable, size_t *n)
LACKING(fmi3GetVariableDependencies, reference dependent, size_t elements[], reference independents[], size_t of_independents[], int kinds[], size_t n)
LACKING(fmi3GetIntervalDecimal, const reference clocks[], size_t n, double intervals[], int qualifiers[])
LACKING(fmi3GetIntervalFraction, const reference clocks[], size_t n, uint64_t counters[], uint64_t resolutions[], int qualifiers[])
LACKING(fmi3GetShiftDecimal, const reference clocks[], size_t n, double shifts[])
LACKING(fmi3GetShiftFraction, const reference clocks[], size_t n, uint64_t counters[], uint64_t resolutions[])
LACKING(fmi3SetIntervalDecimal, const reference clocks[], size_t n, const double intervals[])
LACKING(fmi3SetIntervalFraction, const reference clocks[], size_t n, const uint64_t counters[], const uint64_t resolutions[])
LACKING(fmi3SetShiftDecimal, const reference clocks[], size_t n, const double shifts[])
LACKING(fmi3SetShiftFraction, const reference clocks[], size_t n, const uint64_t counters[], const uint64_t resolutions[])
LACKING(fmi3ActivateModelPartition, reference clock, double time)
LACKING(fmi3GetOutputDerivatives, const reference variables[], size_t n, const int32_t orders[], double values[], size_t nvalues)
EXPORT status FMI(fmi3EnterConfigurationMode)(instance of) { return lacks(of, "fmi3EnterConfigurationMode"); }
EXPORT status FMI(fmi3ExitConfigurationMode)(instance of) { return lacks(of, "fmi3ExitConfigurationMode"); }
EXPORT status FMI(fmi3EnterStepMode)(instance of) { return lacks(of, "fmi3EnterStepMode"); }

/* ---- Saved states. ---- */

EXPORT status FMI(fmi3GetFMUState)(instance of, void **state)
{
    BEGIN("fmi3GetFMUState", ANY);
    return unit_save(x, state);
}

EXPORT status FMI(fmi3SetFMUState)(instance of, void *state)
{
    BEGIN("fmi3SetFMUState", ANY);
    return unit_restore(x, state);
}

EXPORT status FMI(fmi3FreeFMUState)(instance of, void **state)
{
    if (!of) return UNIT_ERROR;
    if (state) free(*state), *state = 0;
    return UNIT_OK;
}

EXPORT status FMI(fmi3SerializedFMUStateSize)(instance of, void *state, size_t *size)
{
    BEGIN("fmi3SerializedFMUStateSize", ANY);
    (void)state;
    *size = unit_serialized_bytes(x);
    return UNIT_OK;
}

EXPORT status FMI(fmi3SerializeFMUState)(instance of, void *state, uint8_t bytes[], size_t size)
{
    BEGIN("fmi3SerializeFMUState", ANY);
    return unit_write(x, state, bytes, size);
}

EXPORT status FMI(fmi3DeserializeFMUState)(instance of, const uint8_t bytes[], size_t size, void **state)
{
    BEGIN("fmi3DeserializeFMUState", ANY);
    return unit_read(x, bytes, size, state);
}

/* ---- Derivatives. ---- */

static int scalars(unit *x, const char *call, size_t nknowns, size_t nseed, size_t nunknowns, size_t nresult)
{
    if (nknowns == nseed && nunknowns == nresult) return UNIT_OK;
    return unit_say(x, UNIT_ERROR, "%s: there are %zu entries of the seed for %zu scalar variables, and %zu derivatives for %zu", call, nseed,
        nknowns, nresult, nunknowns);
}

EXPORT status FMI(fmi3GetDirectionalDerivative)(instance of, const reference unknowns[], size_t nunknowns, const reference knowns[],
    size_t nknowns, const double seed[], size_t nseed, double sensitivity[], size_t nsensitivity)
{
    BEGIN("fmi3GetDirectionalDerivative", ANY & ~ONLY(INSTANTIATED));
    if (scalars(x, "fmi3GetDirectionalDerivative", nknowns, nseed, nunknowns, nsensitivity)) return UNIT_ERROR;
    return unit_along(x, unknowns, nunknowns, knowns, nknowns, seed, sensitivity);
}

EXPORT status FMI(fmi3GetAdjointDerivative)(instance of, const reference unknowns[], size_t nunknowns, const reference knowns[],
    size_t nknowns, const double seed[], size_t nseed, double sensitivity[], size_t nsensitivity)
{
    BEGIN("fmi3GetAdjointDerivative", ANY & ~ONLY(INSTANTIATED));
    if (scalars(x, "fmi3GetAdjointDerivative", nunknowns, nseed, nknowns, nsensitivity)) return UNIT_ERROR;
    return unit_adjoint(x, unknowns, nunknowns, knowns, nknowns, seed, sensitivity);
}

/* ---- Model Exchange. ---- */

EXPORT status FMI(fmi3EvaluateDiscreteStates)(instance of)
{
    BEGIN("fmi3EvaluateDiscreteStates", ONLY(INITIALIZING) | ONLY(EVENT_MODE));
    return unit_update(x);
}

EXPORT status FMI(fmi3UpdateDiscreteStates)(instance of, bool *again, bool *terminate, bool *nominals, bool *states, bool *next_defined,
    double *next)
{
    BEGIN("fmi3UpdateDiscreteStates", ONLY(EVENT_MODE));
    *again = *terminate = *nominals = *states = false;
    const status found = unit_events(x, next);
    *next_defined = isfinite(*next);
    return found;
}

EXPORT status FMI(fmi3EnterContinuousTimeMode)(instance of)
{
    BEGIN("fmi3EnterContinuousTimeMode", ONLY(EVENT_MODE));
    *x->mode = CONTINUOUS_TIME;
    return UNIT_OK;
}

EXPORT status FMI(fmi3CompletedIntegratorStep)(instance of, bool no_restore, bool *event, bool *terminate)
{
    BEGIN("fmi3CompletedIntegratorStep", ONLY(CONTINUOUS_TIME));
    (void)no_restore;
    *event = *terminate = false;
    return UNIT_OK;
}

EXPORT status FMI(fmi3SetTime)(instance of, double time)
{
    BEGIN("fmi3SetTime", ONLY(EVENT_MODE) | ONLY(CONTINUOUS_TIME));
    return unit_set_time(x, time);
}

EXPORT status FMI(fmi3SetContinuousStates)(instance of, const double states[], size_t n)
{
    BEGIN("fmi3SetContinuousStates", ONLY(CONTINUOUS_TIME));
    return unit_set_states(x, states, n);
}

EXPORT status FMI(fmi3GetContinuousStates)(instance of, double states[], size_t n)
{
    BEGIN("fmi3GetContinuousStates", ANY & ~ONLY(INSTANTIATED));
    return unit_get_states(x, states, n);
}

EXPORT status FMI(fmi3GetContinuousStateDerivatives)(instance of, double derivatives[], size_t n)
{
    BEGIN("fmi3GetContinuousStateDerivatives", ANY & ~ONLY(INSTANTIATED));
    return unit_get_rates(x, derivatives, n);
}

EXPORT status FMI(fmi3GetEventIndicators)(instance of, double indicators[], size_t n)
{
    BEGIN("fmi3GetEventIndicators", ANY & ~ONLY(INSTANTIATED));
    return unit_get_indicators(x, indicators, n);
}

EXPORT status FMI(fmi3GetNominalsOfContinuousStates)(instance of, double nominals[], size_t n)
{
    BEGIN("fmi3GetNominalsOfContinuousStates", ANY & ~ONLY(INSTANTIATED));
    const size_t wanted = (size_t)(x->nfq + x->nfu);
    if (n != wanted) return unit_say(x, UNIT_ERROR, "an array has %zu entries, expected %zu, one for each continuous state", n, wanted);
    for (size_t i = 0; i < n; ++i) nominals[i] = 1.0;
    return UNIT_OK;
}

EXPORT status FMI(fmi3GetNumberOfEventIndicators)(instance of, size_t *n)
{
    BEGIN("fmi3GetNumberOfEventIndicators", ANY);
    *n = (size_t)x->model->nindicators;
    return UNIT_OK;
}

EXPORT status FMI(fmi3GetNumberOfContinuousStates)(instance of, size_t *n)
{
    BEGIN("fmi3GetNumberOfContinuousStates", ANY);
    *n = (size_t)(x->nfq + x->nfu);
    return UNIT_OK;
}

/* ---- Co-Simulation. ---- */

EXPORT status FMI(fmi3DoStep)(instance of, double t, double h, bool no_restore, bool *event, bool *terminate, bool *early, double *last)
{
    BEGIN("fmi3DoStep", ONLY(STEP_MODE));
    (void)no_restore;
    *event = *terminate = *early = false;
    const int found = unit_step(x, t, h);
    *last = *x->t;
    return found;
}
