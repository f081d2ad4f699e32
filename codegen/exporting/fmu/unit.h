/* One instance of a functional mock-up unit (FMU), the same for both versions of the standard. fmi2.c and fmi3.c, with
 * fmi.h, translate its calls.
 *
 * Variables have a value reference: time; all coordinates; all speeds; time derivatives of the independent coordinates and speeds;
 * parameters; inputs; outputs; event indicators, in this order. */
#ifndef ORDERNM_UNIT_H
#define ORDERNM_UNIT_H

#include "../motion/inside.h"

/* Content of a model, in NAME_fmu.c. */
typedef struct {
    const char *token;                /* the instantiation token of version 3.0, the GUID of version 2.0 */
    const ordernm_system *system;
    const scalar *q, *u, *p;          /* initial state with closed loops at the default parameters, and these parameters */
    int (*initial)(const scalar *p, scalar *q, scalar *u, scalar *work); /* computes initial values; NULL if they are constant */
    int (*initial_along)(const scalar *p, const scalar *dp, scalar *q, scalar *u, scalar *dq, scalar *du, scalar *work); /* derivatives */
    int at_rest;                      /* whether the initial state is the equilibrium at the default parameters */
    const char *const *variables;     /* names by value reference */
    const char *const *singular;      /* names of singular links, loops, elements, outputs by the status that a function returns; NULL at the end */
    const char *const *switches;      /* descriptions of all switches */
    const int *indicators, *scheduled; /* held switches: [nindicators] with an event indicator, [nscheduled] with times known in advance */
    int nindicators, nscheduled;
    int moved;                        /* whether prescribed motion makes the loops depend on time */
    int method;                       /* of the integrator */
    scalar rtol;                      /* of the integrator, unless the importer gives a tolerance */
} unit_model;

extern const unit_model ordernm_unit_model;

enum { UNIT_OK, UNIT_WARNING, UNIT_DISCARD, UNIT_ERROR };
enum { INSTANTIATED, INITIALIZING, EVENT_MODE, CONTINUOUS_TIME, STEP_MODE, TERMINATED };
enum { OF_TIME, OF_Q, OF_U, OF_RATE, OF_PARAMETER, OF_INPUT, OF_OUTPUT, OF_SWITCH, OF_NOTHING };

typedef struct unit unit;
struct unit {
    const unit_model *model;
    const ordernm_system *system;
    int integrates;                   /* Co-Simulation */
    void (*log)(unit *x, int status, const char *text);
    void *environment, *callback;     /* of the importer */
    char *instance;                   /* the importer's name for the instance */
    ordernm_problem problem;
    ordernm_results results;
    ordernm_motion *motion;
    int nq, nu, np, ni, ny, ns, nfq, nfu; /* lengths */
    long saved;                       /* number of doubles of the state of the instance, which starts at `mode` */
    scalar *mode;                     /* INSTANTIATED, ... */
    scalar *t, *stop, *step, *rtol;   /* time, stop time, size of the integrator's next step, its tolerance */
    scalar *closed;                   /* whether the loops are closed */
    scalar *given;                    /* [nfq + nfu] whether the importer has set an initial value */
    scalar *q, *u, *p, *inputs;       /* dependent entries of q and u are those of the last closed state */
    scalar *modes;                    /* [ns] held modes; 0 for actual branches */
    scalar *known;                    /* [1 + nfq + np + ni] time, independent coordinates, parameters, inputs of the last closed state */
    int computed;                     /* whether the next four arrays belong to the current state */
    scalar *qdot, *udot, *outputs, *switches;
    scalar *way, *near;               /* arguments and coordinates between the last closed state and the current one */
    scalar *dq, *du, *dp, *di, *dt;   /* seeds or gradients */
    scalar *dqdot, *dudot, *doutputs, *dfull_q, *dfull_u, *dswitches;
    scalar *gradient[5];              /* sums of gradients with respect to q, u, p, inputs, t */
    scalar *atol, *points;            /* tolerances; control points of inputs during a step */
    scalar knots[6], rows[2];
    scalar *row;                      /* of results */
    void *memory[2];
};

static const scalar HALF_A_TURN = 3.14159265358979323846;

/* unit.c */
unit *unit_new(int integrates, const char *instance, void (*log)(unit *x, int status, const char *text), void *environment, void *callback);
void unit_free(unit *x);
void unit_reset(unit *x);
int unit_say(unit *x, int status, const char *format, ...);
static inline int unit_trial(const unit *x) { return *x->mode == CONTINUOUS_TIME ? UNIT_DISCARD : UNIT_ERROR; }
int unit_has(unit *x, size_t n, const void *one, const void *other);
int unit_of(const unit *x, unsigned variable, int *index);
const char *unit_name(const unit *x, unsigned variable);
int unit_in(unit *x, const char *call, unsigned modes);
int unit_start(unit *x, scalar t, scalar tolerance, scalar stop);
int unit_started(unit *x);
int unit_get(unit *x, const unsigned *variables, size_t n, scalar *values);
int unit_set(unit *x, const unsigned *variables, size_t n, const scalar *values);
int unit_set_time(unit *x, scalar t);
int unit_set_states(unit *x, const scalar *states, size_t n);
int unit_get_states(unit *x, scalar *states, size_t n);
int unit_get_rates(unit *x, scalar *rates, size_t n);
scalar unit_indicator(const unit *x, int i, scalar *slope);
int unit_get_nominals(unit *x, scalar *nominals, size_t n);
int unit_get_indicators(unit *x, scalar *values, size_t n);
int unit_events(unit *x, scalar *next);
int unit_step(unit *x, scalar t, scalar h);

/* unit_saved.c */
size_t unit_serialized_bytes(const unit *x);
int unit_save(unit *x, void **saved);
int unit_restore(unit *x, const void *saved);
int unit_read(unit *x, const unsigned char *bytes, size_t n, void **saved);
int unit_write(unit *x, const void *saved, unsigned char *bytes, size_t n);

/* unit_state.c */
void unit_change(unit *x);
int unit_update(unit *x);
void unit_took_step(unit *x);
int unit_settle(unit *x, scalar rounding);
void unit_arguments(unit *x, ordernm_call *c);
int unit_failed(unit *x, int status);

/* unit_derivatives.c */
int unit_next_event(unit *x, scalar after, scalar *next);
int unit_along(unit *x, const unsigned *unknowns, size_t nunknowns, const unsigned *knowns, size_t nknowns, const scalar *seed,
    scalar *result);
int unit_adjoint(unit *x, const unsigned *unknowns, size_t nunknowns, const unsigned *knowns, size_t nknowns, const scalar *seed,
    scalar *result);

#endif
