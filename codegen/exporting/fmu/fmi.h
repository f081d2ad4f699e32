/* Functions that both versions of the standard have. fmi2.c and fmi3.c define NAME(name), the name of a function, the words below, and the
 * types `boolean` and `byte`, then include this file. Declarations follow the standard, whose header files are not needed.
 *
 * TOKEN_NAME   the standard's term for the text that identifies the FMU, for messages
 * COUNT        last parameter of functions of variables
 * STATE        FMUstate or FMUState
 * DESERIALIZE  name of the function that reads a saved state
 * GET_RATES    name of the function for time derivatives of the states
 * SET_STATES   modes in which states can be set */
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

#define JOINED(a, b) JOIN(a, b)
#define JOIN(a, b) a##b
#define TEXT_OF(name) TEXT(name)
#define TEXT(name) #name

#ifdef PREFIX
#define FMI(name) JOINED(PREFIX, NAME(name))
#else
#define FMI(name) NAME(name)
#endif

typedef void *instance;
typedef uint32_t reference;
typedef int status;
typedef const char *text;

enum { ALL_MODES = (1 << TERMINATED) - 1, ANY = ALL_MODES | 1 << TERMINATED };
#define ONLY(mode) (1u << (mode))
#define KNOWN (ANY & ~ONLY(INSTANTIATED))

/* Refuses null pointers, and calls in a state in which the standard forbids them. */
#define BEGIN(name, modes) \
    unit *const x = (unit *)of; \
    if (!x || unit_in(x, TEXT_OF(NAME(name)), modes)) return UNIT_ERROR

/* Calls the importer's function for messages. */
static void log_text(unit *x, int s, const char *words);

static const char *category_of(int s)
{
    return s == UNIT_WARNING ? "logStatusWarning" : s == UNIT_DISCARD ? "logStatusDiscard" : "logStatusError";
}

static status lacks(instance of, const char *what)
{
    return of ? unit_say((unit *)of, UNIT_ERROR, "%s: this FMU has no such capability", what) : UNIT_ERROR;
}

/* Functions of the standard that this FMU lacks, each with its arguments. */
#define LACKING(name, ...) \
    EXPORT status FMI(name)(instance of, __VA_ARGS__) { return lacks(of, TEXT_OF(NAME(name))); }
#define LACKING_ALL(name) \
    EXPORT status FMI(name)(instance of) { return lacks(of, TEXT_OF(NAME(name))); }

/* Functions for variables of other types; a call with no variables is allowed. */
#define OTHER_TYPE(Type, type) \
    EXPORT status FMI(Get##Type)(instance of, const reference variables[], size_t n, type values[] COUNT) \
    { \
        return of && !n ? UNIT_OK : lacks(of, "variables of type " #Type); \
    } \
    EXPORT status FMI(Set##Type)(instance of, const reference variables[], size_t n, const type values[] COUNT) \
    { \
        return of && !n ? UNIT_OK : lacks(of, "variables of type " #Type); \
    }

/* ---- Instances. ---- */

static unit *instantiate(const char *name, const char *token, int integrates, void *environment, void *callback)
{
    unit none = {.environment = environment, .callback = callback, .log = log_text};
    if (token && !strcmp(token, ordernm_unit_model.token)) return unit_new(integrates, name, log_text, environment, callback);
    unit_say(&none, UNIT_ERROR, "the %s is %s, expected %s", TOKEN_NAME, token ? token : "a null pointer", ordernm_unit_model.token);
    return 0;
}

EXPORT status FMI(SetDebugLogging)(instance of, boolean on, size_t n, const text categories[])
{
    (void)on, (void)n, (void)categories; /* errors and warnings are always logged, and nothing else is */
    return of ? UNIT_OK : UNIT_ERROR;
}

EXPORT void FMI(FreeInstance)(instance of) { unit_free((unit *)of); }

EXPORT status FMI(ExitInitializationMode)(instance of)
{
    BEGIN(ExitInitializationMode, ONLY(INITIALIZING));
    return unit_started(x);
}

EXPORT status FMI(Terminate)(instance of)
{
    BEGIN(Terminate, ONLY(EVENT_MODE) | ONLY(CONTINUOUS_TIME) | ONLY(STEP_MODE));
    *x->mode = TERMINATED;
    return UNIT_OK;
}

EXPORT status FMI(Reset)(instance of)
{
    if (!of) return UNIT_ERROR;
    unit_reset((unit *)of);
    return UNIT_OK;
}

/* ---- Saved states. ---- */

EXPORT status FMI(JOINED(Get, STATE))(instance of, void **state)
{
    BEGIN(JOINED(Get, STATE), ANY);
    return unit_save(x, state);
}

EXPORT status FMI(JOINED(Set, STATE))(instance of, void *state)
{
    BEGIN(JOINED(Set, STATE), ANY);
    return unit_restore(x, state);
}

EXPORT status FMI(JOINED(Free, STATE))(instance of, void **state)
{
    if (!of) return UNIT_ERROR;
    if (state) free(*state), *state = 0;
    return UNIT_OK;
}

EXPORT status FMI(JOINED(JOINED(Serialized, STATE), Size))(instance of, void *state, size_t *size)
{
    BEGIN(JOINED(JOINED(Serialized, STATE), Size), ANY);
    (void)state;
    *size = unit_serialized_bytes(x);
    return UNIT_OK;
}

EXPORT status FMI(JOINED(Serialize, STATE))(instance of, void *state, byte bytes[], size_t size)
{
    BEGIN(JOINED(Serialize, STATE), ANY);
    return unit_write(x, state, (unsigned char *)bytes, size);
}

EXPORT status FMI(DESERIALIZE)(instance of, const byte bytes[], size_t size, void **state)
{
    BEGIN(DESERIALIZE, ANY);
    return unit_read(x, (const unsigned char *)bytes, size, state);
}

/* ---- Model Exchange. ---- */

EXPORT status FMI(EnterContinuousTimeMode)(instance of)
{
    BEGIN(EnterContinuousTimeMode, ONLY(EVENT_MODE));
    *x->mode = CONTINUOUS_TIME;
    return UNIT_OK;
}

EXPORT status FMI(CompletedIntegratorStep)(instance of, boolean no_restore, boolean *event, boolean *terminate)
{
    BEGIN(CompletedIntegratorStep, ONLY(CONTINUOUS_TIME));
    (void)no_restore;
    *event = *terminate = 0;
    return UNIT_OK;
}

EXPORT status FMI(SetTime)(instance of, double time)
{
    BEGIN(SetTime, ONLY(EVENT_MODE) | ONLY(CONTINUOUS_TIME));
    return unit_set_time(x, time);
}

EXPORT status FMI(SetContinuousStates)(instance of, const double states[], size_t n)
{
    BEGIN(SetContinuousStates, SET_STATES);
    return unit_set_states(x, states, n);
}

EXPORT status FMI(GetContinuousStates)(instance of, double states[], size_t n)
{
    BEGIN(GetContinuousStates, KNOWN);
    return unit_get_states(x, states, n);
}

EXPORT status FMI(GET_RATES)(instance of, double derivatives[], size_t n)
{
    BEGIN(GET_RATES, KNOWN);
    return unit_get_rates(x, derivatives, n);
}

EXPORT status FMI(GetEventIndicators)(instance of, double indicators[], size_t n)
{
    BEGIN(GetEventIndicators, KNOWN);
    return unit_get_indicators(x, indicators, n);
}

EXPORT status FMI(GetNominalsOfContinuousStates)(instance of, double nominals[], size_t n)
{
    BEGIN(GetNominalsOfContinuousStates, KNOWN);
    return unit_get_nominals(x, nominals, n);
}
