/* Shared by the integrator's files: the layout of the state in memory, and the functions of each file.
 *
 * A file calls files of lower rows only; tests/test_layers.py reads the rows:
 *
 *     control, backwards, curvature                        a motion step by step; its adjoint; tangents of the adjoint
 *     room, explicit_backwards, radau_backwards, switches_backwards     memory and start; the adjoint of a step, and of switches
 *     explicit_curvature, radau_curvature, switches_curvature     tangents of a step, of a switch, and of their adjoints
 *     steps, step_sizes, events, results, lost, transposes  between steps; step sizes; events; stored results; directions without
 *                                                           derivatives; the adjoint of a state
 *     gradient_tangents, radau_transposed                  tangents of the adjoint of a state; transposed equations of a step
 *     explicit, radau, passing, points, powers             one step; passing a switch; singular points; unbounded derivatives
 *     coincidences                                         events and knots at the same time as a switch
 *     radau_sensitivities, switches, poses, dead_points    derivatives of a step; modes; poses where loops lose rank
 *     radau_equations, report, errors, timing              equations of a step; a row of results; errors of steps and of times
 *     flow                                                 derivatives along the motion
 *     state, linear, extremes                              one state with closed loops; linear equations; extrema of outputs
 *     inputs, sizes, sums                                  splines; lengths of rows; sums of rates
 *
 * The integrated state is one array z of `size` doubles: the independent coordinates and speeds, integrals of outputs, predictions
 * of the dependent coordinates, then for each group of directions the derivatives of the first three of these four parts, with the
 * direction as last index. Closure determines dependent speeds and coordinates whenever rates are computed; the integrated dependent
 * coordinates are only starting values of Newton's method. Parts start at cache lines and are padded with zeros. */
#ifndef ORDERNM_MOTION_INSIDE_H
#define ORDERNM_MOTION_INSIDE_H

#include "motion.h"

#include <stddef.h>

typedef ordernm_scalar scalar;

/* Memory of the caller, which is divided up from its start; `at` is 0 if only the size is requested. */
typedef struct {
    char *at;
    size_t used;
} memory;

/* The given number of bytes, aligned to a cache line. */
static inline void *ordernm_take(memory *of, size_t bytes)
{
    void *found = of->at ? of->at + of->used : 0;
    of->used += (bytes + 63)/64*64;
    return found;
}

static inline scalar *ordernm_numbers(memory *of, long n)
{
    return (scalar *)ordernm_take(of, (size_t)(n > 0 ? n : 1)*sizeof(scalar));
}

/* The first cache line in the caller's memory. */
static inline void *ordernm_line(scalar *room)
{
    char *const at = (char *)room;
    return at + (64 - (size_t)at%64)%64;
}

enum { LANES = 8, MOST_STAGES = 16 };
enum { ORDERNM_SIDES = 12 };  /* number of places near a point at which rates are sampled, see points.c */
enum { HALVES = 40 };         /* maximum number of bisections of an interval in which rates may jump */

/* Directions that are evaluated together. */
typedef struct {
    int width, index;         /* 1, 4 or 8 lanes; index of the system's functions for this width */
    int first, used;          /* index of the first direction, and number of lanes in use */
    long at;                  /* start of the group's derivatives in z */
    scalar *dp;               /* [np][width] */
} group;

/* A sum of rates: z + h*sum(factor*rate[which]). */
typedef struct {
    int count;
    int which[MOST_STAGES];
    scalar factor[MOST_STAGES];
} row;

/* An integration method: it makes a step from z, where the rates are rate[0], to next. */
typedef struct {
    int stages;               /* number of stages of a step; rate[stages] is the rate at the end of the step */
    int all;                  /* number of stages including those of the interpolant */
    int order;                /* the error of a step is proportional to the step size to this power */
    int (*step)(ordernm_motion *m, scalar h, scalar *error);                   /* computes a step; error: relative to the tolerance */
    int (*complete)(ordernm_motion *m, scalar h);                              /* computes the stages of the interpolant */
    void (*interpolate)(ordernm_motion *m, scalar h, scalar theta, scalar *z); /* computes the state at t + theta h */
    /* the next three members are for explicit methods only */
    const row *rows;          /* sums for the stages; the one with the number `stages` is the end of the step */
    const scalar *times;      /* times of the stages, relative to the step */
    void (*weights)(scalar theta, scalar *factor); /* factors of all rates in the state at t + theta h */
    int gives_rate;           /* a step leaves the rate at its end in rate[stages] */
    scalar gap;               /* the place in a step that is farthest from all stages; 0: condition numbers of stages are not stored */
    void (*keep)(const ordernm_motion *m, scalar *row); /* stores data for the adjoint in a row of steps, after the state */
} scheme;

/* A function of the system, for the precision with which the loops were closed last. */
#define ORDERNM_OF(m, function) ((m)->precise ? (m)->system->precise->function : (m)->system->function)
#define ORDERNM_VALUES_OF(m, function) ((m)->precise_values ? (m)->system->precise->function : (m)->system->function)

/* A tried step. */
typedef struct {
    scalar h, end;            /* size, and time at the end */
    scalar wall, knot;        /* latest time at which the step may end; the next knot of the inputs */
    int to_wall, to_pose;     /* whether the step ends at the wall; whether a pose where a loop loses rank limits the step size */
    int again;                /* whether to repeat the step, because a stage was too near to a pose where a loop loses rank */
    int at_pose;              /* whether the step and the motion end at a pose where a loop loses rank */
    int apart;                /* a dropped condition is open by too much after the step */
    scalar dead;              /* position of a dead point of the independent coordinates in the step, relative to the step; else 0 */
    scalar error;             /* error relative to the tolerance */
    int event;                /* number of the event at the end of the step; -1 for none */
    scalar event_time;        /* time of the event */
} trial;

struct ordernm_motion {
    const ordernm_problem *problem;
    const ordernm_system *system;
    const scheme *method;
    int ny, nx, nd;           /* numbers of independent coordinates and speeds, integrals, dependent coordinates */
    int identity;             /* whether all coordinates and speeds are independent; z then has the layout of the system's arrays */
    long values, size;        /* doubles of z without and with derivatives */
    int ngroups;
    group *groups;            /* [ngroups + 1] the last one is the direction of the motion itself, see flow.c */
    int flowing;              /* whether derivatives along the last direction are computed */
    scalar flow_error, flow_step, flow_at; /* error along the last direction; size and start of the step that was tried last */
    int flow_unknown;         /* whether derivatives of rates along the motion must be computed anew at the start of the next step */
    scalar flow_most, flow_most_step; /* the largest error of the steps tried from the same start, and its step */
    int *dependent;           /* [nd] indices of dependent coordinates */
    int *turned;              /* [nquaternions] whether a quaternion is dependent */
    scalar *lengths;          /* [nquaternions] norms before the loops are closed */
    scalar *z, *next;         /* states at the start and end of the step */
    scalar *rate[MOST_STAGES];
    scalar *trial, *zeros, *error[2];
    scalar *work, *q, *u, *qdot, *udot, *newton, *position, *condition, *outputs, *inputs;
    scalar *dq, *du, *dqdot, *dudot, *full_dq, *full_du, *doutputs, *dinputs;
    scalar *dt;               /* [LANES] zeros as seeds, since time is not differentiated here; transposes write to this array */
    scalar *row;
    scalar *stages;           /* states of an explicit method's stages after the first: values, coordinates with loops closed */
    void *precise_work;
    scalar poor;              /* condition number above which loops are closed, and rates computed, in long double */
    scalar poor_rates;        /* the same limit for derivatives of rates and outputs, and for rows of results */
    int derived;              /* whether derivatives are needed, forward or by the adjoint */
    scalar best;              /* the smallest condition number at the start of a step so far */
    int precise;              /* whether derivatives are computed in long double at the state whose loops were closed last */
    int precise_values;       /* whether rates are computed in long double, too; otherwise by the functions in double */
    int precise_at_end;       /* the value of `precise` at the end of the tried step */
    unsigned precise_stages;  /* the values of `precise` at the stages, one bit each */
    scalar too_poor;          /* condition number that no stage should exceed, because even long double would exceed the tolerance */
    scalar telling;           /* condition number above which a stage should keep its distance from the pose */
    scalar *closed;           /* [nq] coordinates at the end of the tried step, loops closed, if known */
    scalar closed_condition;
    int closed_known;
    scalar conditions[MOST_STAGES]; /* condition numbers at the stages and at the end of a step */
    scalar *ranks;            /* [MOST_STAGES][nloops] inverse condition numbers of each loop at the stages and at the end */
    scalar *ranks_between;    /* inverse condition numbers at places between the stages */
    scalar apart, apart_at_end; /* residual of dropped conditions: when loops were closed last, and at the end of the tried step */
    int widest;               /* the dropped condition with the largest residual */
    scalar *flat;             /* [1 + 2 nq] a pose passed in the step, as in the results; its time is -INFINITY if there is none */
    scalar calm_rank, calm_growth; /* inverse condition number, and growth of dependent speeds, at the start of an approach; see dead_points.c */
    scalar shorter;           /* size of the next step if that step must end before a dead point; else 0 */
    int refused;              /* number of repetitions of a step because of a dead point */
    scalar hopeless;          /* condition number above which results are interpolated from places near the pose */
    scalar *known_row, *beside; /* an interpolated row of results, and the rows from which it is interpolated */
    scalar *at_pose;          /* the interpolated state */
    scalar *probe[5];         /* [values]; see ordernm_undetermined */
    int row_known;
    scalar pose;              /* estimated time at which a loop loses rank; else -INFINITY */
    scalar refused_pose, refused_step, refused_error; /* last step across a pose with too large an error: time of the pose, size, error */
    scalar mark;              /* time of the motion some steps ago */
    long marked;              /* number of steps made until the time `mark` */
    scalar looked_at;         /* see ordernm_problem */
    int moved;                /* number of repetitions of a step with shifted stages */
    int imprecise;            /* whether long double is needed, but not available yet */
    /* current state */
    scalar t, h;
    long segment;             /* piece of the inputs' spline that contains this step */
    long sampled;             /* number of result times already passed */
    int stopped;              /* whether an event has stopped the motion */
    int begun, adaptive, rejected_before, complete;
    scalar *crossing, *after, *within; /* [nevents] outputs minus levels at the start and end of the step, and in between */
    scalar *part;             /* [nevents] position of the event in the step */
    scalar *happened, *paces; /* [nevents] 1.0 if the step ends at the event; range of the output in the step over the step size */
    scalar *at_first;         /* [nevents] outputs minus levels at the first event of the step */
    scalar *samples;          /* outputs minus levels at places between the ends of the step */
    scalar around_event[2];   /* times in the step that bracket the event at its end */
    scalar beside_event[2];   /* one of the two times around the event, and the output minus the level at that time */
    scalar error_to_event;    /* error of the step that was repeated to end at the event */
    int root;                 /* switch at whose zero the tried step starts or ends, see powers.c; -1 for none, MANY_ROOTS */
    int beside_power;         /* whether a zero of a power or root is near the step, where rates may change as steeply as in a jump */
    scalar root_end;          /* end of the last step that started or ended at the zero of a root; else -INFINITY */
    ordernm_results *results;
    scalar stable;            /* largest factor on the next step size that stability permits, if derivatives are needed */
    scalar *fast, growth;     /* the direction in which rates change most, and its growth factor in the previous step */
    int fast_steps;           /* number of steps in which this direction is still monitored */
    int far_steps, near_steps; /* numbers of consecutive steps of an explicit method at its stability limit, and below it */
    scalar error_before;      /* error of the previous step, relative to the tolerance; 0 at the start */
    scalar advice;            /* recommended factor on the next step size; 0: the error estimate determines the size */
    struct radau *radau;      /* data of Radau IIA, else 0 */
    /* switches */
    int nheld, nwatched;      /* numbers of switches with held modes, and of these switches and events together */
    int *held;                /* [nheld] numbers of the switches with held modes */
    scalar *modes, *switches; /* [nswitches] modes, and switching functions */
    scalar *crossed;          /* [nswitches] `paces` of switching functions in the previous step, if it ended at their zero; else 0 */
    scalar *dswitches, *switch_along; /* [nswitches][LANES]; [ngroups][LANES] */
    scalar *input_rates, *no_dp; /* [ninputs]; zeros, [np] */
    scalar *changed;          /* [nswitches] times of the last changes of modes */
    scalar accumulating;      /* start of the count of passed switches */
    long passed;              /* number of switches passed since `accumulating` */
    int last_passed;          /* the switch passed last */
    scalar *let_go;           /* [nswitches] modes before a step without held modes; 0 for held modes */
    int not_held;             /* consecutive steps rejected because held rates are not finite */
    scalar *passing_time;     /* [ngroups][LANES] derivatives of the time at which the last switch was passed */
    scalar *passing_speed;    /* [nswitches] rates of switching functions when they were passed last */
    scalar *switch_errors;    /* [nswitches][2] errors of switching functions, see timing.c */
    scalar *switch_time;      /* [ngroups][LANES] derivatives of the time of the last switch of an output with an event */
    scalar *speeds;           /* [nswitches] rates of switching functions before switches just passed with a jump of rates; else 0 */
    int ntogether, *together; /* number of switches passed at the same time, and these switches in their order */
    int together_jump;        /* whether rates jump at one of these switches */
    scalar together_since, *z_before, *modes_before, *switches_kept; /* time, state and modes before the first of these switches; scratch */
    scalar *z_after;          /* the state after these switches, as if all were passed at once */
    scalar *lost;             /* [ngroups][LANES] NaN for directions without a derivative from now on; else 0 */
    int *resting;             /* [nswitches] memory for switches at which the motion rests */
    int nbent, *bent;         /* number and indices of switches whose functions are zero and change their rates at the last knot */
    int npoints;              /* number of singular functions that are monitored */
    scalar *singular;         /* [5][nswitches] values of singular functions in the step */
    scalar singular_at;       /* the time of the last row of `singular`; NaN: the values are not known */
    scalar *sides[ORDERNM_SIDES]; /* [size] rates on both sides of a point, see points.c */
    scalar *at_point;         /* [size] the state at the point */
    scalar *moved_p;          /* [np] parameters near the point */
    const scalar *p;          /* parameters in use: the problem's, or moved_p */
    scalar *halves[HALVES + 1]; /* [values] rates at the bisection times, and the smallest jumps */
    int suspects;             /* number of steps in which rates may jump without a known switch */
    int jumps_at_end;         /* whether a jump of rates without a known switch is suspected at the end of this step */
    scalar turning;           /* largest step in which no half-turn angle leaves its mode by too much; 0: no limit */
    int switched;             /* whether modes have changed between the previous step and this one */
    long head;                /* how many numbers precede the state in a row of steps */
};

static inline void ordernm_note_precise(ordernm_motion *m, int stage)
{
    m->precise_stages = (m->precise_stages & ~(1u << stage)) | (unsigned)m->precise << stage;
}

/* Smallest value of a switching function, on its new side, after the switch was passed. */
static const scalar LEAST_SIDE = 1e-300;
/* Switches count as simultaneous if their times differ by less than this fraction of the motion's duration. */
static const scalar AT_THE_SAME_TIME = 1e-9;

/* Difference of derivatives, relative to their jumps, above which the order of simultaneous switches matters. */
static const scalar ORDER_MATTERS = 1e-6;

enum { SLIDES = -1000, REFUSED = -1001 }; /* in addition to the status of functions: rates on both sides push back to a switch; at_knot has
                                             ended the motion */

/* sums.c */
void ordernm_combine(long n, scalar *out, const scalar *z, scalar h, int count, const int *which, const scalar *factor,
    scalar *const *rate);
int ordernm_all_finite(const scalar *x, long n);
int ordernm_finite_along(const scalar *S, long n, int width, int lane);

/* lengths of rows are in motion.h */
enum { RK4_STAGES = 4, DOP853_STAGES = 12, RADAU_STAGES = 3 };
int ordernm_kind(const ordernm_problem *p);
/* Whether derivatives along the motion itself limit steps: rates, or outputs that are integrated, may be steep. */
static inline int ordernm_may_be_steep(const ordernm_motion *m) { return (m->system->steep & (m->nx ? 3 : 1)) != 0; }

static inline long ordernm_whole_lines(long n) { return (n + 7)/8*8; }

/* inputs.c */
enum { ORDERNM_ORDERS = 3 };  /* time derivatives of inputs, orders 0 to 2: the value, the rate, the acceleration */
static inline int ordernm_signals(const ordernm_system *s) { return s->ninputs - 2*s->nmoving; }
void ordernm_find_segment(ordernm_motion *m, scalar t, scalar h);
void ordernm_find_next_segment(ordernm_motion *m);
scalar ordernm_next_knot(const ordernm_motion *m, scalar t);
int ordernm_reach_knot(ordernm_motion *m);
long ordernm_input_weights(const ordernm_motion *m, scalar t, int of_order, scalar value[ORDERNM_ORDERS][ORDERNM_MOST_DEGREE + 1]);
int ordernm_signal_of(const ordernm_system *s, int input, int *order);
void ordernm_input_rates(ordernm_motion *m, scalar t, int of_order, scalar *rates);
const scalar *ordernm_inputs_at(ordernm_motion *m, scalar t);
scalar *ordernm_input_directions(ordernm_motion *m, scalar t, const group *g, int of_order);

/* state.c */
enum { RATES = 1, INTEGRALS = 2, KNOWN_CLOSED = 4, PRECISE = 8 }; /* rates of the state; of integrals; loops are known to be closed, and in long
                                                                     double */
void ordernm_normalise(scalar *e, scalar *de, int width);
void ordernm_expand(ordernm_motion *m, const scalar *z);
void ordernm_arguments(ordernm_motion *m, scalar t, const scalar *z, ordernm_call *c);
void ordernm_seeds(ordernm_motion *m, scalar t, const scalar *z, const group *g, ordernm_call *c);
int ordernm_close_loops(ordernm_motion *m, ordernm_call *c);
int ordernm_rates_of(ordernm_motion *m, scalar t, const scalar *z, scalar *rate, int ngroups, const group *groups, int what);
int ordernm_rates(ordernm_motion *m, scalar t, const scalar *z, scalar *rate);
int ordernm_rates_at_end(ordernm_motion *m, scalar t, scalar *rate);
int ordernm_settle(ordernm_motion *m, scalar t, scalar *z);
int ordernm_along_time(ordernm_motion *m, scalar t, const scalar *z, const scalar *rate, ordernm_call *c);
void ordernm_note_condition(ordernm_motion *m, int stage, int status);

/* report.c */
int ordernm_report(ordernm_motion *m, scalar t, const scalar *z, scalar *row);
int ordernm_report_rates(ordernm_motion *m, scalar t, const scalar *z, scalar *rates);
int ordernm_describe(ordernm_motion *m, scalar t, const scalar *z, scalar *row);

/* errors.c */
int ordernm_counted(const ordernm_motion *m);
scalar ordernm_error_norm(const ordernm_motion *m, const scalar *next, const scalar *error, const scalar *second);
void ordernm_note_coarse(ordernm_motion *m, scalar h);
int ordernm_worst_entry(const ordernm_motion *m);

/* flow.c */
void ordernm_follow_flow(ordernm_motion *m);
void ordernm_set_flow(ordernm_motion *m);
int ordernm_begin_flow(ordernm_motion *m);
scalar ordernm_error_along_flow(ordernm_motion *m, scalar h, scalar of_state, const scalar *rate);

/* explicit.c, radau.c */
extern const scheme ordernm_rk4, ordernm_dop853, ordernm_radau;
void ordernm_keep_stage(ordernm_motion *m, int stage);
size_t ordernm_radau_layout(ordernm_motion *m, void *at);
size_t ordernm_radau_layout_stages(ordernm_motion *m, int n, void *at);

/* dead_points.c */
enum { RANKS_BETWEEN = 35 }; /* places evaluated together */
int ordernm_jumped(const ordernm_motion *m, const scalar *z);
int ordernm_undetermined(ordernm_motion *m);
scalar ordernm_dead_point_within(ordernm_motion *m, scalar h);

/* poses.c */
static const scalar LOST = 1e300; /* condition number of a loop that has lost rank */
typedef int ordernm_describing(ordernm_motion *m, scalar t, const scalar *z, scalar *row);
enum { BESIDE = 6 };
int ordernm_find_pose(ordernm_motion *m, scalar h);
int ordernm_rounded_at_pose(const ordernm_motion *m, scalar h, scalar error);
int ordernm_beside(ordernm_motion *m, scalar h, ordernm_describing *describe, long size);
int ordernm_beside_within(ordernm_motion *m, scalar h, scalar part, long size);
scalar ordernm_step_at_pose(const ordernm_motion *m, scalar h, scalar wall);

/* events.c */
enum { EVENT_SAMPLES = 7 };  /* number of places between the ends of a step at which outputs are evaluated */
int ordernm_crossings(ordernm_motion *m, scalar t, const scalar *z, scalar *g);
int ordernm_look_for_events(ordernm_motion *m, trial *step);
int ordernm_keep_events(ordernm_motion *m, const trial *step, int *stop);
int ordernm_jumped_events(ordernm_motion *m, int by_state, int *stop);

/* timing.c */
int ordernm_find_switch_errors(ordernm_motion *m, scalar t, const scalar *z);
int ordernm_find_output_error(ordernm_motion *m, scalar t, const scalar *z, int output, scalar *error);
scalar ordernm_switch_error(const ordernm_motion *m, int k);
int ordernm_may_precede(const ordernm_motion *m, scalar after, const scalar *error, scalar rate, int k);

/* coincidences.c */
int ordernm_compare_with_front(ordernm_motion *m, int e, scalar *row);
int ordernm_compare_events(ordernm_motion *m);
void ordernm_look_beside_knot(ordernm_motion *m, long before);

/* switches.c */
int ordernm_switch_speed(ordernm_motion *m, scalar t, const scalar *z, const scalar *rate, int k, scalar *found);
int ordernm_timing_switch(ordernm_motion *m, scalar t, const scalar *z, const scalar *rate, const scalar *crossed, int k, scalar *speed,
    int *by);
int ordernm_switch_along(ordernm_motion *m, scalar t, const scalar *z, int k);
int ordernm_remove_jumped(ordernm_motion *m, int k, const scalar *before, int *left);
int ordernm_follow(ordernm_motion *m, scalar t, const scalar *z, const scalar *crossed);
int ordernm_rates_jump(const ordernm_motion *m, const scalar *before, const scalar *after);
scalar ordernm_other_mode(const ordernm_motion *m, int k);
int ordernm_matters(const ordernm_motion *m, int k);
void ordernm_hold_switches(ordernm_motion *m);
int ordernm_switching(ordernm_motion *m, scalar t, const scalar *z);
scalar ordernm_side(const ordernm_motion *m, int k);
int ordernm_sides(ordernm_motion *m, scalar t, const scalar *z, scalar *sides);
int ordernm_choose_modes(ordernm_motion *m, scalar t, const scalar *z);
int ordernm_hold_again(ordernm_motion *m);
int ordernm_limit_turns(ordernm_motion *m);
int ordernm_let_go(ordernm_motion *m);
int ordernm_begins_at_zero(ordernm_motion *m, int k, scalar *speed);
int ordernm_begins_at_jump(ordernm_motion *m, int k);
int ordernm_errs_past_jump(ordernm_motion *m, int k);
int ordernm_modes_before_start(ordernm_motion *m);
void ordernm_touch(ordernm_motion *m, scalar t, int k);
int ordernm_arrive_at_knot(ordernm_motion *m);
int ordernm_follow_inputs(ordernm_motion *m);
void ordernm_keep_modes(const ordernm_motion *m, scalar *row);
void ordernm_take_modes(ordernm_motion *m, const scalar *row);
void ordernm_modes_beside(ordernm_motion *m, const scalar *row, const scalar *before, int k, int after);

/* extremes.c */
scalar ordernm_event_point(int i);
int ordernm_extremes(const scalar *value, scalar *where);

/* passing.c */
int ordernm_pass_switches(ordernm_motion *m);
int ordernm_accumulates(const ordernm_motion *m);

/* results.c */
int ordernm_failed(ordernm_results *r, int status);
int ordernm_not_finite(ordernm_motion *m, const scalar *rate);
int ordernm_wants_precise(ordernm_motion *m);
int ordernm_keep(ordernm_motion *m, scalar t, const scalar *z);
int ordernm_sample(ordernm_motion *m, scalar end);
void ordernm_keep_step(const ordernm_motion *m, scalar h);

/* points.c */
typedef struct {
    int which;                /* index of the singular function */
    scalar part;              /* position of the function's zero in the step */
    int before, after;        /* whether rates before and after the point use the current modes */
} point;
void ordernm_between(const ordernm_motion *m, scalar h, scalar x, scalar *z);
int ordernm_next_point(ordernm_motion *m, const trial *step, point *found);
int ordernm_near_point(ordernm_motion *m, const trial *step);
int ordernm_look_at_point(ordernm_motion *m, scalar h, const point *at);
int ordernm_rates_are_rough(const ordernm_motion *m, scalar h, const point *at);
int ordernm_lost_at_point(ordernm_motion *m, scalar h, const point *at, int n, int lane);

/* powers.c */
enum { MANY_ROOTS = -2 };
int ordernm_begin_at_root(ordernm_motion *m);
int ordernm_beside_root(ordernm_motion *m, const trial *step);
scalar ordernm_error_beside_powers(ordernm_motion *m, const trial *step, scalar error);
int ordernm_growing_power(ordernm_motion *m, const trial *step);

/* lost.c */
void ordernm_lose_infinite(ordernm_motion *m, const scalar *z);
void ordernm_lose_at_start(ordernm_motion *m);
void ordernm_doubt_start(ordernm_motion *m, int k);
void ordernm_lose_at_knot(ordernm_motion *m);
void ordernm_look_at_samples(ordernm_motion *m);
void ordernm_look_for_lost(ordernm_motion *m, const trial *step);

/* step_sizes.c */
int ordernm_first_step(ordernm_motion *m, scalar limit, scalar *h);
void ordernm_watch_stability(ordernm_motion *m, const trial *step);
int ordernm_plan(ordernm_motion *m, trial *step);
scalar ordernm_after_failure(const ordernm_motion *m, scalar error);
void ordernm_resize(ordernm_motion *m, const trial *step);

/* steps.c */
static inline void ordernm_exchange(scalar **one, scalar **other)
{
    scalar *const kept = *one;
    *one = *other;
    *other = kept;
}
int ordernm_next_step(ordernm_motion *m, scalar end, scalar knot, int settled, const scalar *modes);
void ordernm_take_derivatives(ordernm_motion *m, scalar best);
void ordernm_note_best(ordernm_motion *m);

#endif
