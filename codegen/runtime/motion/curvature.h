/* Shared by the files of Hessian products: the adjoint with its tangents, and one state. */
#ifndef ORDERNM_CURVATURE_H
#define ORDERNM_CURVATURE_H

#include "inside.h"

/* Derivatives of a function with respect to its arguments. */
typedef struct {
    scalar *q, *u, *p, *inputs, *t;
} gradient;

struct ordernm_curvature {
    ordernm_problem problem;
    ordernm_results none;
    ordernm_hessians *found;
    ordernm_motion *motion;
    int n, all;                       /* entries of the state with derivatives; stages of a step with those of its interpolant */
    long next, left;                  /* numbers of times passed forwards, and still to process backwards */
    scalar *lambda, *kappa[MOST_STAGES], *nu;
    gradient values, along;           /* results: of one vector of weights, and in lanes */
    scalar *no_dt;                    /* zeros for time */
    long passed, passed_left, passed_all; /* the same numbers of steps that begin at switches; all such steps */
    scalar *before, *jump;            /* rates before a switch, and minus those after it */
    scalar *one, *of_switch;          /* [nswitches] unit weights; memory for gradients at a switch */
    scalar *next_switch;              /* of the switch passed next: gradients of its function and of this function's rate, whether rates jump, time */
    scalar *p;                        /* sums of gradients with respect to parameters, along directions: in lanes, by group */
    scalar *b, *db;                   /* weights of udot, and their tangents; zero for dependent speeds */
    scalar *rate_weights, *dqdot;     /* the same for the rates of coordinates that are not speeds */
};

/* Length of the derivatives of weighted outputs at a state, [1 + k][n + np + ninputs]. */
static inline long ordernm_source_size(const ordernm_curvature *c)
{
    const ordernm_system *const s = c->motion->system;
    return (1L + c->problem.ndirections)*(c->n + s->np + s->ninputs);
}

/* Adds a multiple of an array to another one. */
static inline void ordernm_add_to(scalar *to, scalar factor, const scalar *of, long n)
{
    for (long i = 0; i < n; ++i) to[i] += factor*of[i];
}

static inline int ordernm_some(const scalar *x, long n)
{
    for (long i = 0; i < n; ++i)
        if (x[i] != 0.0) return 1;
    return 0;
}

/* gradient_tangents.c */
void ordernm_unpack(const ordernm_curvature *c, const scalar *z, scalar *to);
void ordernm_pack(const ordernm_curvature *c, const scalar *from, scalar *z);
int ordernm_rates_and_keep(const ordernm_curvature *c, scalar t, const scalar *z, scalar *rate, int stage, scalar *to);
int ordernm_close_and_keep(const ordernm_curvature *c, scalar t, const scalar *z, scalar *to);
int ordernm_gradients_along(ordernm_curvature *c, scalar t, const scalar *z, const scalar *record, const scalar *kappa, scalar *nu,
    int values);
int ordernm_gradients_of(ordernm_curvature *c, scalar t, const scalar *z, const scalar *record, const scalar *kappa, scalar *nu,
    const group *g);
void ordernm_clear_gradient(const ordernm_curvature *c, const gradient *of, int width);
void ordernm_add_inputs(ordernm_curvature *c, scalar t, int of_order, const scalar *of, int width, long from, int used, scalar factor);
scalar ordernm_add_row(const ordernm_curvature *c, const gradient *of, int width, int lane, scalar *row);
int ordernm_outputs_along(ordernm_curvature *c, scalar t, const scalar *record, const scalar *weights, scalar *source);
void ordernm_take_record(const ordernm_curvature *c, const scalar *record, scalar *z);
void ordernm_add_source(ordernm_curvature *c, scalar t, scalar factor, const scalar *source, scalar *nu);
int ordernm_states_within(ordernm_curvature *c, scalar h, scalar until);
void ordernm_samples_back(ordernm_curvature *c, scalar h, void (*weights)(scalar theta, scalar *factor), int count, scalar by);

/* explicit_curvature.c, radau_curvature.c: a step from m->z to m->next with the records of its stages, and times and weights of integrands;
 * the step back, where integrands are the sources at its stages, or null */
int ordernm_explicit_along(ordernm_curvature *c, const scalar *step, scalar until, scalar *records, scalar *nodes);
int ordernm_explicit_along_back(ordernm_curvature *c, scalar h, const scalar *records, const scalar *integrands);
int ordernm_radau_step_along(ordernm_curvature *c, const scalar *step, scalar until, scalar *records, scalar *nodes);
int ordernm_radau_along_back(ordernm_curvature *c, scalar h, const scalar *records, const scalar *integrands);

/* switches_curvature.c: passes the switches at the start of a stored step, whose row contains these modes; the adjoint before them */
enum { ROWS_OF_A_SWITCH = 4 }; /* gradients at a switch that are stored at once */
int ordernm_look_at_begin(ordernm_curvature *c);
int ordernm_switches_along(ordernm_curvature *c, const scalar *modes);
int ordernm_switches_along_back(ordernm_curvature *c, const scalar *modes);

#endif
