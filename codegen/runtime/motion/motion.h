/* Integration over time of a generated system, with exact sensitivities.
 *
 * A package defines `NAME_system` in NAME_motion.c: its functions and sizes. An ordernm_problem describes a motion. The motion
 * uses memory of the caller. It runs to its end, for a given number of seconds, or until the memory for results is full:
 *
 *     ordernm_motion *m = ordernm_begin(&problem, calloc(ordernm_room(&problem), sizeof(double)));
 *     while (ordernm_go(m, &results, 0.1) == ORDERNM_PAUSED) say_how_far(results.t);
 *
 * No function allocates memory, keeps data outside the given memory, or prints. Times are in s, everything else in SI units
 * and radians. A direction of differentiation is any combination of parameters, initial values and inputs.
 */
#ifndef ORDERNM_MOTION_H
#define ORDERNM_MOTION_H

#include "scalar.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- Contents of a generated package. ---- */

/* Arguments and results of all functions of a package; each function uses some of them. Arrays whose names start with d are [n][width]: a
 * row for each entry, with a number for each direction. Transposes read arrays of derivatives and write arrays of seeds. */
typedef struct {
    const ordernm_scalar *q, *u, *p, *inputs;
    ordernm_scalar t;
    ordernm_scalar *dq, *du, *dp, *dinputs, *dt;
    ordernm_scalar *qdot, *udot, *dqdot, *dudot;
    ordernm_scalar *outputs, *doutputs;
    const ordernm_scalar *modes; /* signs of switching functions that fix the branches; 0 for the actual branches */
    ordernm_scalar *switches, *dswitches;
    ordernm_scalar *full_u, *dfull_q, *dfull_u;
    ordernm_scalar *step, *position, *condition;
    const ordernm_scalar *b, *db; /* weights of udot in Hessian products and their tangents */
    const ordernm_scalar *rate_weights, *output_weights, *switch_weights; /* weights of other results in Hessian products */
    const ordernm_scalar *found_dudot; /* tangents of udot, known from the forward run; the next members are results */
    ordernm_scalar *dgq, *dgu, *dgp, *dginputs, *dgt;
    ordernm_scalar *gradient_q, *gradient_u, *gradient_p, *gradient_inputs, *gradient_t;
    ordernm_scalar *work;
    void *precise_work;       /* of long doubles */
} ordernm_call;

/* Returns 0, or the number of the zero pivot, as in the package's header. */
typedef int ordernm_function(const ordernm_call *call);

/* Functions for one, eight and four directions; those for four are 0 until NAME_four has set them. */
enum { ORDERNM_ONE, ORDERNM_EIGHT, ORDERNM_FOUR, ORDERNM_WIDTHS };

/* The same functions in long double, for poses near which a loop loses rank; see NAME_precise.c. Each of these functions except
 * closing_step closes the loops again in long double. Functions that the package lacks are 0. */
typedef struct {
    ordernm_function *closing_step, *state_rates, *completion, *outputs, *switches;
    ordernm_function *state_rate_sensitivities[ORDERNM_WIDTHS], *completion_sensitivities[ORDERNM_WIDTHS],
        *output_sensitivities[ORDERNM_WIDTHS], *switch_sensitivities[ORDERNM_WIDTHS];
    ordernm_function *sensitivities_transposed[ORDERNM_WIDTHS], *coordinate_rate_sensitivities_transposed[ORDERNM_WIDTHS],
        *completion_sensitivities_transposed[ORDERNM_WIDTHS], *output_sensitivities_transposed[ORDERNM_WIDTHS],
        *switch_sensitivities_transposed[ORDERNM_WIDTHS];
} ordernm_precise;

/* Kinds of switches. The mode of a switch is the sign of its function. With ORDERNM_POWER, higher derivatives of the rates are unbounded
 * near its zero, as for max(0, x)^1.5. With ORDERNM_ROOT, first derivatives may be, as for sqrt(max(0, x)). With ORDERNM_TURN, the
 * function is an angle that jumps at half a turn, and the mode is a reference angle. ORDERNM_POINT is a singular function without a mode,
 * at whose zero rates may be undefined. */
enum { ORDERNM_SIGN, ORDERNM_POWER, ORDERNM_ROOT, ORDERNM_TURN, ORDERNM_POINT };

typedef struct {
    int nq, nu, np, ninputs, noutputs, nclosure, nloops;
    int plain_rates;                       /* whether the time derivatives of the coordinates are the speeds */
    long workspace;                        /* doubles */
    int nfree_q, nfree_u;                  /* numbers of independent coordinates and speeds */
    const int *free_q, *free_u;            /* indices of independent coordinates and speeds */
    int nquaternions;
    const int *quaternion;                 /* index of the first component of each in q */
    int nkept;
    const int *kept;                       /* indices of the retained closure conditions */
    int ndropped;
    const int *dropped;                    /* indices of the conditions that were dropped as redundant */
    ordernm_scalar apart;                  /* largest residual that the dropped conditions may have */
    ordernm_scalar slack;                  /* largest residual that retained, nearly redundant conditions may have */
    int split;                             /* whether a joint has both independent and dependent speeds */
    int nswitches;                         /* number of switching functions, at whose zeros forces or outputs change their branch */
    const int *switch_kind;                /* kind of each switch, see ORDERNM_SIGN */
    const int *drives;                     /* whether forces (1) or prescribed motion (2) depend on each switch */
    int nswitch_outputs;                   /* number of pairs: a switch, and an output that depends on it */
    const int *switch_of_output;
    int steep;                             /* bits for functions that may change steeply, such as tanh(u/1e-3): 1 in rates, 2 in outputs */
    int nmoving;                           /* number of inputs of prescribed motion */
    const int *moving;                     /* indices of these inputs; the last 2*nmoving inputs are their rates and accelerations */
    /* Functions that were not generated are 0. */
    const ordernm_precise *precise;        /* to be set when ordernm_go returns ORDERNM_IMPRECISE */
    ordernm_function *state_rates, *closing_step, *completion, *outputs, *switches;
    ordernm_function *state_rate_sensitivities[ORDERNM_WIDTHS], *completion_sensitivities[ORDERNM_WIDTHS],
        *output_sensitivities[ORDERNM_WIDTHS], *switch_sensitivities[ORDERNM_WIDTHS];
    ordernm_function *sensitivities_transposed[ORDERNM_WIDTHS], *coordinate_rate_sensitivities_transposed[ORDERNM_WIDTHS],
        *completion_sensitivities_transposed[ORDERNM_WIDTHS], *output_sensitivities_transposed[ORDERNM_WIDTHS],
        *switch_sensitivities_transposed[ORDERNM_WIDTHS];
    ordernm_function *gradient_tangents[ORDERNM_WIDTHS]; /* tangents of the gradient of b.udot, with tangents of b; also the gradient */
    ordernm_function *switch_hessian_products[ORDERNM_WIDTHS], *output_hessian_products[ORDERNM_WIDTHS]; /* if the package has them */
    ordernm_function *coordinate_rate_hessian_products[ORDERNM_WIDTHS]; /* only if rates of coordinates are not speeds */
} ordernm_system;

/* ---- Input. ---- */

enum { ORDERNM_RK4, ORDERNM_DOP853, ORDERNM_RADAU };

/* Inputs over time: a spline of any degree, such as 0 (steps), 1 or 3, as a sum of B-splines. Before the first knot and after the last one
 * the spline is constant. Without knots, inputs are constant, and count is 1. If prescribed motion depends on nmoving inputs, the last
 * 2*nmoving inputs are the rates and accelerations of these, which are time derivatives of the spline. The control points are those of the
 * other inputs, the signals: nsignals = ninputs - 2*nmoving. The spline of a signal that prescribes motion must have a continuous rate,
 * also at its ends if the motion extends beyond them. */
enum { ORDERNM_MOST_DEGREE = 9 };

typedef struct {
    int degree;
    long count;
    const ordernm_scalar *knots; /* [count + degree + 1], or null */
    const ordernm_scalar *values; /* [count][nsignals]; 0 for zeros */
    const ordernm_scalar *directions; /* [ndirections][count][nsignals]; 0 for zeros */
} ordernm_inputs;

/* An output that crosses a level. */
typedef struct {
    int output;
    ordernm_scalar level;
    int direction;            /* 1: upward only, -1: downward only, 0: both */
    int stop;                 /* the motion ends at the event */
} ordernm_event;

typedef struct ordernm_motion ordernm_motion;

typedef struct {
    const ordernm_system *system;
    int method;
    const ordernm_scalar *p;  /* [np] */
    const ordernm_scalar *q, *u; /* the consistent initial state */
    int ndirections;
    const ordernm_scalar *dq, *du; /* [ndirections][nq], [ndirections][nu]: derivatives of the initial state; null if all are zero */
    const ordernm_scalar *dp; /* [ndirections][np]; null if all are zero */
    ordernm_inputs inputs;
    ordernm_scalar start, end;
    long ntimes;
    const ordernm_scalar *times; /* increasing times of results, from start to end; ntimes 0: at every step */
    ordernm_scalar step;      /* step size of ORDERNM_RK4; for other methods the first step size, 0 to choose it */
    int fixed;                /* whether other methods also use the size `step` throughout, whatever their errors */
    ordernm_scalar largest_step; /* 0: no limit */
    long most_steps;          /* 0: no limit */
    ordernm_scalar poor;      /* condition number of loops above which the motion stops with ORDERNM_POOR between steps; 0: no limit */
    ordernm_scalar looked_at; /* replaces `poor` by 3*looked_at until the condition number falls below `poor` */
    ordernm_scalar rtol;
    const ordernm_scalar *atol; /* [nfree_q + nfree_u + nintegrals]; then nq entries for the coordinates if nothing is independent */
    const ordernm_scalar *atol_directions; /* [ndirections]: tolerances of sensitivities; 0: only errors of the state count */
    int nintegrals;
    const int *integrals;     /* outputs to integrate over time */
    int nevents;
    const ordernm_event *events;
    /* For sampled controllers: called at the start and at each knot of the inputs that a step has reached; 0 for none. It may read the
     * state with ordernm_row, and set values and directions of the inputs from this knot on. If it does not return 0, the motion ends with
     * ORDERNM_REFUSED. */
    int (*at_knot)(void *context, ordernm_motion *motion, ordernm_scalar t);
    void *context;
} ordernm_problem;

/* ---- Results. ---- */

enum {
    ORDERNM_ENDED, ORDERNM_PAUSED, ORDERNM_FULL, ORDERNM_EVENT, ORDERNM_SINGULAR, ORDERNM_OPEN, ORDERNM_COLLAPSED,
    ORDERNM_NOT_FINITE, ORDERNM_MANY_STEPS, ORDERNM_IMPRECISE, ORDERNM_POOR,
    ORDERNM_UNDETERMINED, /* small errors of independent speeds become large errors of dependent speeds, for example at a dead point */
    ORDERNM_SLIDING,     /* rates on both sides of a switch drive the motion back to it: see component */
    ORDERNM_ACCUMULATED, /* switches occur faster and faster: see component */
    ORDERNM_APART,       /* the residual of a dropped condition, see component, would exceed `apart` of the system */
    ORDERNM_REFUSED      /* at_knot has ended the motion */
};

/* Rows of results: t, q, u, outputs, integrals, then dq [ndirections][nq], du, doutputs, dintegrals. */
typedef struct {
    ordernm_scalar *rows;
    long capacity, count;
    /* `steps` has a row of ordernm_step_size doubles for each step, for ordernm_backwards; not stored if steps is 0. `known` has data of
     * the method before the first step, ordernm_known_size doubles, for ordernm_replay; not stored if known is 0. */
    ordernm_scalar *steps, *known;
    long steps_capacity, steps_count;
    /* Events that occurred, and their numbers, as rows of ordernm_event_size. Each contains a row as above, time derivatives of
     * coordinates [nq], speeds [nu] and outputs, and derivatives of the time if the output has jumped over its level. The last entry is
     * the range of the output in the step over the step size, units/s; after a jump, it is ORDERNM_JUMPED (with an input) or
     * ORDERNM_JUMPED_BY_STATE (at a switch), and the row describes the state after the jump. Not stored if events is 0. */
    ordernm_scalar *events;
    int *which;
    long events_capacity, events_count; /* up to twice the number of events may occur at once */
    /* Poses passed at which a loop has lost rank: time, and coordinates [nq] near it and farther away. Only with derivatives; not stored
     * if flat is 0. */
    ordernm_scalar *flat;
    long flat_capacity, flat_count;
    /* Directions along which derivatives no longer exist: a row of results in which these derivatives are NaN, the reason (see
     * ORDERNM_INFINITE), and the switch or state entry. A motion without directions stores only the first place where derivatives may cease
     * to exist. Nothing is stored if lost is 0. Rows for results at the time of a switch are stored while more than ndirections rows are
     * free. */
    ordernm_scalar *lost;
    int *lost_why;            /* [lost_capacity][2] */
    long lost_capacity, lost_count;
    ordernm_scalar t;         /* time reached */
    int singular;             /* status of the function that failed */
    int grazed;               /* 0, or 1 + index of a switch that was only touched: derivatives do not exist from there on */
    int not_held;             /* 0, or 1 + index of a switch that was passed although its branch has no value beyond it: derivatives lack its jump */
    int together, together_with; /* 0, or 1 + indices of the last two switches passed at the same time, with a jump of rates or of an event's output */
    ordernm_scalar together_at; /* time of these switches: if their order matters, the adjoint does not exist */
    int ordered;              /* the order of these switches matters along a direction, whose derivatives are NaN from there on */
    int event_together;       /* 0, or 1 + index of an event at the same time as the switch together_with */
    int event_ordered;        /* rows of events have NaN for derivatives that depend on the order of event and switch */
    int moved;                /* 0, or 1 + index of a switch of prescribed motion that was passed */
    ordernm_scalar moved_at;  /* time of that switch: if the velocity of that motion jumps there, results lack the impulse on other
                               * bodies. Python's simulate finds such a jump in advance, and ends the motion before it */
    int late;                 /* 0, or 1 + index of a switch passed at a pose where a loop loses rank; no step can end at such a pose */
    ordernm_scalar late_at;   /* time of that switch; the branch before the switch was used for a tenth of a step longer */
    int component;            /* state entry that limited the step size or was not finite; some reasons give the number another meaning */
    long accepted, rejected, evaluations, closing_steps, jacobians, factorizations;
    int as_is;                /* set by the caller: functions in long double are not available */
    ordernm_scalar condition; /* the largest condition number of the closure matrices */
    ordernm_scalar condition_here; /* the condition number of the closure matrices at the end of the last step */
    ordernm_scalar next_step; /* size of the next step, s */
    ordernm_scalar coarse, coarsest, coarse_at; /* of ORDERNM_RK4 in models with loops or steep functions: the sum of the steps' errors
                               * relative to the state; the largest error, and the start of its step */
    int coarse_entry;         /* the state entry with this error */
    ordernm_scalar coarse_along, coarsest_along, coarse_along_at; /* the same for derivatives along the motion, in models with steep
                               * functions */
    ordernm_scalar stiffness; /* step size times largest eigenvalue, if it limited the steps of an explicit method; else 0 */
} ordernm_results;

/* Reasons for the loss of a direction: derivatives of rates are not finite; the motion rests at a switch; rates jump without a switch;
 * the motion passes the zero of a singular function; the motion begins at a switch at which rates jump;
 * the motion reaches such a switch at a knot of the inputs, where the rate of the switching function changes;
 * results at the time of such a switch, whose derivatives are those of one side. */
enum { ORDERNM_INFINITE, ORDERNM_RESTS, ORDERNM_JUMPS, ORDERNM_PASSES, ORDERNM_BEGINS, ORDERNM_BENDS, ORDERNM_SAMPLED };

enum { ORDERNM_JUMPED = -1, ORDERNM_JUMPED_BY_STATE = -2 };

/* Number of doubles of memory for a motion. */
long ordernm_room(const ordernm_problem *problem);

/* Numbers of doubles in a row of results, in an event, in a step and in the head of a step, and in the data that a method keeps between
 * steps in addition to the state. */
long ordernm_row_size(const ordernm_problem *problem);
long ordernm_event_size(const ordernm_problem *problem);
long ordernm_step_size(const ordernm_problem *problem);
long ordernm_head_size(const ordernm_problem *problem);
long ordernm_known_size(const ordernm_problem *problem);

/* Starts a motion. Only at_knot may change the problem and its arrays afterwards. */
ordernm_motion *ordernm_begin(const ordernm_problem *problem, ordernm_scalar *room);

/* Continues: to the end, for about the given number of seconds (0 for any time), or until results are full. After ORDERNM_FULL, provide
 * more memory and call again. After ORDERNM_IMPRECISE, near a pose where a loop loses rank, set the system's functions in long double, or
 * `as_is` in the results, and call again. */
int ordernm_go(ordernm_motion *motion, ordernm_results *results, double seconds);

/* The current state: independent coordinates and speeds, dependent coordinates, and zeros for dependent speeds. */
void ordernm_state(const ordernm_motion *motion, ordernm_scalar *q, ordernm_scalar *u);

/* The current state as a row of results. Returns 0, or the status of a function. */
int ordernm_row(ordernm_motion *motion, ordernm_results *results, ordernm_scalar *row);

/* ---- The discrete adjoint: gradients of weighted sums of results, from the end to the start. ---- */

/* Functionals are weighted sums of outputs and states at times, and of integrals at the end. */
typedef struct {
    int nfunctionals;
    long ntimes;
    const ordernm_scalar *times;      /* increasing times of the weighted results, which may differ from the problem's times of results */
    const ordernm_scalar *weights;    /* [nfunctionals][ntimes][noutputs]; 0 for none */
    const ordernm_scalar *state_weights; /* [nfunctionals][ntimes][nq + nu]; 0 for none */
    long nbehind;                     /* number of times just after jumps at events, with weights of outputs */
    const ordernm_scalar *behind;     /* these times, increasing, as in the rows of events; a step starts at each */
    const ordernm_scalar *behind_weights; /* [nfunctionals][nbehind][noutputs] weights of outputs at these times */
    const ordernm_scalar *time_weights; /* [nfunctionals][nbehind] weights of the times themselves, for times that a switch determines */
    const ordernm_scalar *integral_weights; /* [nfunctionals][nintegrals]; 0 for none */
    const ordernm_scalar *end_q, *end_u; /* [nfunctionals][nq], [nu]: weights of independent entries of the state at the end; 0 for none */
    const ordernm_scalar *whole_q, *whole_u; /* [nq], [nu]: the state at the end, if end_q and end_u weight all entries; else 0 */
    /* Gradients with respect to independent entries of the initial state, parameters and values of inputs. The caller sets these arrays to
     * zero. */
    ordernm_scalar *q, *u, *p, *inputs; /* [nfunctionals][nq], [nu], [np], [count][nsignals] */
    long evaluations, transposes;
    int singular;
} ordernm_gradients;

typedef struct ordernm_adjoint ordernm_adjoint;

/* Number of doubles of memory for gradients. Starts the adjoint; sets `singular` if weights of a whole state cannot be used.
 * ordernm_backwards processes steps that ordernm_go stored. Stored steps may be passed in parts, the last part first; the steps within a
 * part are in the order of time. The motion's problem may have no directions. */
long ordernm_adjoint_room(const ordernm_problem *problem, const ordernm_gradients *gradients);
ordernm_adjoint *ordernm_adjoint_begin(const ordernm_problem *problem, ordernm_gradients *gradients, ordernm_scalar *room);
int ordernm_backwards(ordernm_adjoint *adjoint, const ordernm_scalar *steps, long count);
void ordernm_adjoint_end(ordernm_adjoint *adjoint);

/* Repeats stored steps. The function reads the whole first row, the heads of all other rows, and the data before the first step. A head has
 * ORDERNM_STEP_HEAD numbers and, for each switch, its mode and whether it was crossed at the start of the step. */
enum { ORDERNM_STEP_HEAD = 6 };
int ordernm_replay(ordernm_motion *motion, const ordernm_scalar *known, ordernm_scalar *steps, long count);

/* ---- Hessian products: tangents of the gradients along the problem's directions. ---- */

/* Why second derivatives may not exist: another switch determines the time of a switch; rates jump at one of two switches that are passed at
 * the same time, but whose functions differ; derivatives of rates jump at a switch at which the motion begins. */
enum { ORDERNM_TIMED_BY_ANOTHER = 1, ORDERNM_AT_THE_SAME_TIME, ORDERNM_BEGINS_AT_A_SWITCH };

/* With k directions and n = nfree_q + nfree_u, the record of a state has 1 + k
 * rows of its independent entries: values, then derivatives along each direction; in models with loops, all nq coordinates follow.
 * Sources are derivatives of a functional with respect to independent entries, parameters and inputs, and the tangents of these
 * derivatives: [1 + k][n + np + ninputs]. */
typedef struct {
    long ntimes;
    const ordernm_scalar *times;      /* increasing times of weighted outputs, from the start to the end */
    ordernm_scalar *states;           /* [ntimes] records at these times, set by ordernm_tangents */
    const ordernm_scalar *sources;    /* [ntimes]: sources at these times */
    ordernm_scalar *passed;           /* [number of steps that begin at switches][record + nswitches]: states and modes before, set by ordernm_tangents */
    const ordernm_scalar *weights;    /* [noutputs]: weights of integrals of outputs */
    const ordernm_scalar *finish;     /* [1 + k][n]: derivatives with respect to the state after the last step, and their tangents; null for zeros */
    /* Gradients and Hessian products. The caller sets p and inputs to zero. */
    ordernm_scalar *start, *p, *inputs; /* [1 + k][n], [np], [count][nsignals] */
    long products;
    int refused, refused_switch;      /* why second derivatives may not exist, and the number of the switch */
} ordernm_hessians;

typedef struct ordernm_curvature ordernm_curvature;

/* ordernm_hessians_room returns the number of doubles of memory. ordernm_tangents repeats steps that ordernm_go stored, in the order of
 * time. It stores the states at the stages of these steps as records [count][all], and the times and weights of integrands at the stages as
 * [count][all][2]. The caller sets both arrays to zero. `all` is ordernm_hessians_stages; a record has ordernm_hessians_record doubles.
 * Parts of the steps follow each other; `until` is the time at the end of a part, infinite for the last one. ordernm_hessians_state then
 * gives the record of the state at the end. Then, for each functional, call ordernm_hessians_turn, ordernm_hessians_backwards for each part
 * from the last to the first, and ordernm_hessians_end. `integrands` contains the sources at the stages, [count][all], or is null;
 * ordernm_hessians_integrands adds them to zeros, and needs output_hessian_products. To repeat a part whose records were not kept, call
 * ordernm_hessians_keep before its tangents are computed, and later ordernm_hessians_take and ordernm_tangents again: `before` has the
 * numbers of output times and of switches passed, the modes, the state and its tangents, [2 + nswitches + (1 + k) n]. */
long ordernm_hessians_room(const ordernm_problem *problem);
ordernm_curvature *ordernm_hessians_begin(const ordernm_problem *problem, ordernm_hessians *found, ordernm_scalar *room);
int ordernm_hessians_stages(const ordernm_curvature *curvature);
long ordernm_hessians_record(const ordernm_curvature *curvature);
int ordernm_tangents(ordernm_curvature *curvature, const ordernm_scalar *steps, long count, ordernm_scalar until, ordernm_scalar *stages,
    ordernm_scalar *nodes);
void ordernm_hessians_keep(const ordernm_curvature *curvature, ordernm_scalar *before);
void ordernm_hessians_take(ordernm_curvature *curvature, const ordernm_scalar *before);
int ordernm_hessians_integrands(ordernm_curvature *curvature, const ordernm_scalar *steps, long count, const ordernm_scalar *stages,
    const ordernm_scalar *nodes, ordernm_scalar *sources);
int ordernm_hessians_state(ordernm_curvature *curvature, ordernm_scalar t, ordernm_scalar *record);
void ordernm_hessians_turn(ordernm_curvature *curvature);
int ordernm_hessians_backwards(ordernm_curvature *curvature, const ordernm_scalar *steps, long count, const ordernm_scalar *stages,
    const ordernm_scalar *integrands);
void ordernm_hessians_end(ordernm_curvature *curvature);

#ifdef __cplusplus
}
#endif

#endif
