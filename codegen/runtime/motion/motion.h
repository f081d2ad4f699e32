/* Motion over time of a system that ordernm has generated, with exact sensitivities.
 *
 * A package has, in NAME_motion.c, `NAME_system`: its functions and sizes. A motion is described by an ordernm_problem,
 * begun in memory of the caller's, and goes on until it has ended, for so many seconds, or until there is no more room for
 * results:
 *
 *     ordernm_motion *m = ordernm_begin(&problem, calloc(ordernm_room(&problem), sizeof(double)));
 *     while (ordernm_go(m, &results, 0.1) == ORDERNM_PAUSED) say_how_far(results.t);
 *
 * No function allocates memory, keeps anything outside of the memory given, or prints. Times are in s, everything else in SI
 * units and radians. Directions are what sensitivities are along: parameters, initial values, inputs, any combination.
 */
#ifndef ORDERNM_MOTION_H
#define ORDERNM_MOTION_H

#include "scalar.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- What a generated package brings. ---- */

/* Arguments and results of a function of a package, for its functions to pick theirs. Of what begins with d there is one row
 * for each entry, [n][width], with a number for each direction; transposes read derivatives there and write seeds. */
typedef struct {
    const ordernm_scalar *q, *u, *p, *inputs;
    ordernm_scalar t;
    ordernm_scalar *dq, *du, *dp, *dinputs, *dt;
    ordernm_scalar *qdot, *udot, *dqdot, *dudot;
    ordernm_scalar *outputs, *doutputs;
    const ordernm_scalar *modes; /* the signs of switching functions that are gone on with; 0 where they have */
    ordernm_scalar *switches, *dswitches;
    ordernm_scalar *full_u, *dfull_q, *dfull_u;
    ordernm_scalar *step, *position, *condition;
    ordernm_scalar *work;
    void *precise_work;       /* of long doubles */
} ordernm_call;

/* Returns 0, or which pivot is zero, as the package's header says. */
typedef int ordernm_function(const ordernm_call *call);

/* Functions over one direction, eight and four at once; the last are 0 until NAME_four has set them. */
enum { ORDERNM_ONE, ORDERNM_EIGHT, ORDERNM_FOUR, ORDERNM_WIDTHS };

/* The same in long double, for poses near which a loop loses rank; NAME_precise.c. But for closing_step they close the loops
 * themselves once more. What the package has not is 0. */
typedef struct {
    ordernm_function *closing_step, *state_rates, *completion, *outputs, *switches;
    ordernm_function *state_rate_sensitivities[ORDERNM_WIDTHS], *completion_sensitivities[ORDERNM_WIDTHS],
        *output_sensitivities[ORDERNM_WIDTHS], *switch_sensitivities[ORDERNM_WIDTHS];
    ordernm_function *sensitivities_transposed[ORDERNM_WIDTHS], *coordinate_rate_sensitivities_transposed[ORDERNM_WIDTHS],
        *completion_sensitivities_transposed[ORDERNM_WIDTHS], *output_sensitivities_transposed[ORDERNM_WIDTHS],
        *switch_sensitivities_transposed[ORDERNM_WIDTHS];
} ordernm_precise;

/* What the mode of a switch is: the sign of its function, of ORDERNM_POWER with rates beside its zero whose higher derivatives grow
 * without bounds, as those of max(0, x)^1.5, of ORDERNM_ROOT with first ones that may, as that of sqrt(max(0, x)); or the angle near which
 * its function, an angle that jumps at half a turn, is measured. A singular function has none: it is zero where rates may have no value. */
enum { ORDERNM_SIGN, ORDERNM_POWER, ORDERNM_ROOT, ORDERNM_TURN, ORDERNM_POINT };

typedef struct {
    int nq, nu, np, ninputs, noutputs, nclosure, nloops;
    int plain_rates;                       /* the coordinates' time derivatives are the speeds */
    long workspace;                        /* doubles */
    int nfree_q, nfree_u;                  /* independent coordinates and speeds ... */
    const int *free_q, *free_u;            /* ... and which ones */
    int nquaternions;
    const int *quaternion;                 /* where each begins in q */
    int nkept;
    const int *kept;                       /* conditions of closure that no others imply */
    int ndropped;
    const int *dropped;                    /* the others, which follow nearly ... */
    ordernm_scalar apart;                  /* ... and may be open by so much */
    ordernm_scalar slack;                  /* conditions that count may be open by so much where others imply them */
    int split;                             /* a joint has independent and dependent speeds */
    int nswitches;                         /* switching functions, at whose zeros forces or outputs change their branch ... */
    const int *switch_kind;                /* ... see ORDERNM_SIGN ... */
    const int *drives;                     /* ... which of them forces (1) or prescribed motion (2) have ... */
    int nswitch_outputs;                   /* ... and pairs of one that an output has, and that output */
    const int *switch_of_output;
    int nmoving;                           /* inputs that prescribed motion reads ... */
    const int *moving;                     /* ... and which ones: their rates and accelerations are the last 2*nmoving inputs */
    /* What has not been generated is 0. */
    const ordernm_precise *precise;        /* to be had when ordernm_go asks for it */
    ordernm_function *state_rates, *closing_step, *completion, *outputs, *switches;
    ordernm_function *state_rate_sensitivities[ORDERNM_WIDTHS], *completion_sensitivities[ORDERNM_WIDTHS],
        *output_sensitivities[ORDERNM_WIDTHS], *switch_sensitivities[ORDERNM_WIDTHS];
    ordernm_function *sensitivities_transposed[ORDERNM_WIDTHS], *coordinate_rate_sensitivities_transposed[ORDERNM_WIDTHS],
        *completion_sensitivities_transposed[ORDERNM_WIDTHS], *output_sensitivities_transposed[ORDERNM_WIDTHS],
        *switch_sensitivities_transposed[ORDERNM_WIDTHS];
} ordernm_system;

/* ---- What is asked for. ---- */

enum { ORDERNM_RK4, ORDERNM_DOP853, ORDERNM_RADAU };

/* Inputs over time: a spline of some degree, such as 0 (steps), 1 or 3, sums of B-splines; before the first and after the last knot it
 * stays as it is there. Without knots, inputs are constant: count is 1. Where prescribed motion reads inputs, the last 2*nmoving
 * inputs, a rate and an acceleration for each of these, are time derivatives of the spline: values are of the others, the signals,
 * nsignals = ninputs - 2*nmoving. Such a spline must have a continuous rate, also at its ends if the motion goes beyond them. */
enum { ORDERNM_MOST_DEGREE = 9 };

typedef struct {
    int degree;
    long count;
    const ordernm_scalar *knots; /* [count + degree + 1], or 0 */
    const ordernm_scalar *values; /* [count][nsignals]; 0 for zeros */
    const ordernm_scalar *directions; /* [ndirections][count][nsignals]; 0 for zeros */
} ordernm_inputs;

/* An output that crosses a level. */
typedef struct {
    int output;
    ordernm_scalar level;
    int direction;            /* 1: upwards only, -1: downwards only, 0: both */
    int stop;                 /* the motion ends there */
} ordernm_event;

typedef struct {
    const ordernm_system *system;
    int method;
    const ordernm_scalar *p;  /* [np] */
    const ordernm_scalar *q, *u; /* the initial state, consistent */
    int ndirections;
    const ordernm_scalar *dq, *du; /* [ndirections][nq], [ndirections][nu]: its derivatives; 0 for zeros */
    const ordernm_scalar *dp; /* [ndirections][np]; 0 for zeros */
    ordernm_inputs inputs;
    ordernm_scalar start, end;
    long ntimes;
    const ordernm_scalar *times; /* where results are wanted, rising, from start to end; ntimes 0: at every step */
    ordernm_scalar step;      /* of ORDERNM_RK4; of others the first one, 0 to leave it to them */
    int fixed;                /* other methods too make steps of this size only, whatever their errors */
    ordernm_scalar largest_step; /* 0 for any */
    long most_steps;          /* 0 for any */
    ordernm_scalar poor;      /* condition of loops above which the motion stops with ORDERNM_POOR, between steps; 0 for any */
    ordernm_scalar looked_at; /* until it has been below that, it stops only beyond three times this one */
    ordernm_scalar rtol;
    const ordernm_scalar *atol; /* [nfree_q + nfree_u + nintegrals]; where nothing is independent, the nq coordinates behind them */
    const ordernm_scalar *atol_directions; /* [ndirections]: errors of sensitivities count too; 0: those of the state only */
    int nintegrals;
    const int *integrals;     /* outputs that are integrated over time */
    int nevents;
    const ordernm_event *events;
} ordernm_problem;

/* ---- What comes of it. ---- */

enum {
    ORDERNM_ENDED, ORDERNM_PAUSED, ORDERNM_FULL, ORDERNM_EVENT, ORDERNM_SINGULAR, ORDERNM_OPEN, ORDERNM_COLLAPSED,
    ORDERNM_NOT_FINITE, ORDERNM_MANY_STEPS, ORDERNM_IMPRECISE, ORDERNM_POOR,
    ORDERNM_UNDETERMINED, /* dependent speeds are known far less exactly than rtol asks for, as at a dead point */
    ORDERNM_SLIDING,     /* forces on both sides of a switch push back to it: see component */
    ORDERNM_ACCUMULATED, /* switches follow each other faster and faster: see component */
    ORDERNM_APART        /* a dropped condition, see component, would be open by more than it may be */
};

/* Rows of results: t, q, u, outputs, integrals, then dq [ndirections][nq], du, doutputs, dintegrals. */
typedef struct {
    ordernm_scalar *rows;
    long capacity, count;
    /* The steps, for ordernm_backwards; rows of ordernm_step_size. Not kept if steps is 0. For ordernm_replay beside them what
     * the method knew before the first of them, ordernm_known_size doubles; not kept if known is 0. */
    ordernm_scalar *steps, *known;
    long steps_capacity, steps_count;
    /* Events that happened, and which; rows of ordernm_event_size: one as above, time derivatives of coordinates [nq], speeds [nu] and
     * outputs, derivatives of the time along directions, of an output that has jumped over its level, and how fast the output changed
     * on the whole in the step that the event was in, units/s; ORDERNM_JUMPED or ORDERNM_JUMPED_BY_STATE of one that has jumped, with
     * an input or at a switch. Such a row is that behind the jump. Not kept if events is 0. */
    ordernm_scalar *events;
    int *which;
    long events_capacity, events_count; /* twice as many as there are events may come at once */
    /* Poses at which a loop has lost rank and that the motion has passed: time, and coordinates [nq] beside it, near and farther away.
     * With derivatives only; not kept if flat is 0. */
    ordernm_scalar *flat;
    long flat_capacity, flat_count;
    /* Where directions have no derivative from then on: a row of results, in which they are NaN, and why, see ORDERNM_INFINITE, and of which
     * switch or entry of the state. Without directions, the first place where that may be. Not kept if lost is 0. */
    ordernm_scalar *lost;
    int *lost_why;            /* [lost_capacity][2] */
    long lost_capacity, lost_count;
    ordernm_scalar t;         /* how far it has come */
    int singular;             /* what the function returned that failed */
    int grazed;               /* 0, or 1 + a switch that was touched only: derivatives do not exist from there on */
    int not_held;             /* 0, or 1 + a switch that was passed where rates beyond it have no value: its jump is not in derivatives */
    int together, together_with; /* 0, or 1 + the last two switches that were passed at one time, where rates or an event's output jump ... */
    ordernm_scalar together_at; /* ... and when: the adjoint does not exist if the order matters */
    int ordered;              /* the order matters along a direction: results have NaN for its derivatives from there on */
    int event_together;       /* 0, or 1 + an event that came at the same time as the switch together_with ... */
    int event_ordered;        /* ... and rows of events have NaN for derivatives that depend on which comes first */
    int moved;                /* 0, or 1 + a switch of prescribed motion that was passed ... */
    ordernm_scalar moved_at;  /* ... and when: if the velocity of that motion jumps there, the impulse on other bodies is missing from
                               * results. Python's simulate finds such a jump beforehand, and ends the motion before it */
    int late;                 /* 0, or 1 + a switch that was passed at a pose where a loop loses rank, and no step can end ... */
    ordernm_scalar late_at;   /* ... and when: its old branch was kept for a tenth of a step more */
    int component;            /* which of the state's entries kept the step small, or was not finite */
    long accepted, rejected, evaluations, closing_steps, jacobians, factorizations;
    int as_is;                /* set: there is nothing in long double */
    ordernm_scalar condition; /* the largest met, of the dependent coordinates by conditions */
    ordernm_scalar condition_here; /* at the last step's end */
    ordernm_scalar next_step; /* that would be tried there, s */
    ordernm_scalar coarse, coarsest, coarse_at; /* of ORDERNM_RK4 in models with loops: errors of steps, relative to the state, in all; the
                               * largest, and in the step from when on */
    ordernm_scalar stiffness; /* step times largest eigenvalue where it kept an explicit method's steps small; else 0 */
} ordernm_results;

/* Derivatives of rates are not finite; the motion stays where a switch is zero; rates jump where none is; the motion passes a point at
 * which a singular function is zero. */
enum { ORDERNM_INFINITE, ORDERNM_RESTS, ORDERNM_JUMPS, ORDERNM_PASSES };

enum { ORDERNM_JUMPED = -1, ORDERNM_JUMPED_BY_STATE = -2 };

typedef struct ordernm_motion ordernm_motion;

/* Doubles of memory that a motion needs. */
long ordernm_room(const ordernm_problem *problem);

/* Doubles of a row of results, of a row of events, of a row of steps and of its head, of what a method knows between two steps beside
 * the state. */
long ordernm_row_size(const ordernm_problem *problem);
long ordernm_event_size(const ordernm_problem *problem);
long ordernm_step_size(const ordernm_problem *problem);
long ordernm_head_size(const ordernm_problem *problem);
long ordernm_known_size(const ordernm_problem *problem);

/* Begins a motion; the problem, and what it points to, must stay as they are. */
ordernm_motion *ordernm_begin(const ordernm_problem *problem, ordernm_scalar *room);

/* Goes on: to the end, for about so many seconds (0 for any time), or until results are full. After ORDERNM_FULL, give more
 * room and call again. After ORDERNM_IMPRECISE, which is near a pose where a loop loses rank, give the system its
 * functions in long double, or say in the results that there are none, and call again. */
int ordernm_go(ordernm_motion *motion, ordernm_results *results, double seconds);

/* Where the motion is: independent coordinates and speeds, dependent coordinates, zero for dependent speeds. */
void ordernm_state(const ordernm_motion *motion, ordernm_scalar *q, ordernm_scalar *u);

/* The same as a row of results. Returns 0, or what a function returned. */
int ordernm_row(ordernm_motion *motion, ordernm_results *results, ordernm_scalar *row);

/* ---- The discrete adjoint: gradients of sums of results, from the end to the beginning. ---- */

/* Functionals are sums of outputs at times, and of integrals at the end, each with a weight. */
typedef struct {
    int nfunctionals;
    long ntimes;
    const ordernm_scalar *times;      /* rising; those of the motion, or others */
    const ordernm_scalar *weights;    /* [nfunctionals][ntimes][noutputs]; 0 for none */
    long nbehind;                     /* of outputs behind jumps of inputs or at switches, where events are: their times, rising, as in the */
    const ordernm_scalar *behind;     /* rows of events; steps begin there */
    const ordernm_scalar *behind_weights; /* [nfunctionals][nbehind][noutputs] */
    const ordernm_scalar *time_weights; /* [nfunctionals][nbehind]: of these times, where a switch makes them */
    const ordernm_scalar *integral_weights; /* [nfunctionals][nintegrals]; 0 for none */
    const ordernm_scalar *end_q, *end_u; /* [nfunctionals][nq], [nu]: of independent entries of the state at the end; 0 for none */
    const ordernm_scalar *whole_q, *whole_u; /* [nq], [nu]: that state, where they are of all its entries, as where independents change; else 0 */
    /* Gradients by the independent entries of the initial state, by parameters, by the inputs' values. Begin with zeros. */
    ordernm_scalar *q, *u, *p, *inputs; /* [nfunctionals][nq], [nu], [np], [count][nsignals] */
    long evaluations, transposes;
    int singular;
} ordernm_gradients;

typedef struct ordernm_adjoint ordernm_adjoint;

/* Doubles of memory that gradients need; beginning, which says in `singular` if weights of a whole state cannot be taken; and going
 * through steps that ordernm_go has kept, given from the last part to the first one, each with its steps in their order. The
 * motion's problem may have no directions. */
long ordernm_adjoint_room(const ordernm_problem *problem, const ordernm_gradients *gradients);
ordernm_adjoint *ordernm_adjoint_begin(const ordernm_problem *problem, ordernm_gradients *gradients, ordernm_scalar *room);
int ordernm_backwards(ordernm_adjoint *adjoint, const ordernm_scalar *steps, long count);
void ordernm_adjoint_end(ordernm_adjoint *adjoint);

/* Makes steps again that were kept: from the first row of steps, whose state is there, from the heads of all rows, which are
 * ORDERNM_STEP_HEAD numbers and, of switches, modes and what has been crossed, and from what was known before the first. */
enum { ORDERNM_STEP_HEAD = 6 };
int ordernm_replay(ordernm_motion *motion, const ordernm_scalar *known, ordernm_scalar *steps, long count);

#ifdef __cplusplus
}
#endif

#endif
