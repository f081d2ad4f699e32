/* What the files of motion share: how the state lies in memory, and what they do for each other.
 *
 * A file calls files of lower rows only; tests/test_layers.py reads the rows:
 *
 *     control, backwards                                   a motion step by step; its adjoint
 *     room, explicit_backwards, radau_backwards, switches_backwards     memory and the beginning; one step, and switches, backwards
 *     steps, step_sizes, events, results, lost, transposes  between steps; how long; events in them; what is kept; directions without
 *                                                           derivatives; a state backwards
 *     explicit, radau, passing, points, powers             one step; over a switch; where rates may have no value, or few derivatives
 *     radau_sensitivities, switches, poses, dead_points    its derivatives; modes; where loops lose rank
 *     radau_equations, report, errors                      its equations; a row of results; errors of steps
 *     state, linear, extremes                              one state with its loops closed; factors; where outputs turn
 *     inputs, sizes, sums                                  splines; how long rows are; sums of rates
 *
 * What is integrated is one array z of `size` doubles: the independent coordinates and speeds, integrals of outputs, predictions
 * of the dependent coordinates, then for each group of directions the derivatives of the first three quarters of these, with the
 * direction as last index. Dependent speeds follow from closure whenever rates are asked for; so do dependent coordinates, which
 * are integrated only for Newton's method to begin near them. Parts begin at whole cache lines; what fills them up is zero. */
#ifndef ORDERNM_MOTION_INSIDE_H
#define ORDERNM_MOTION_INSIDE_H

#include "motion.h"

#include <stddef.h>

typedef ordernm_scalar scalar;

/* Memory of the caller's, handed out from its beginning; `at` is 0 where only its size is asked for. */
typedef struct {
    char *at;
    size_t used;
} memory;

/* So many bytes, from a cache line on. */
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

/* The first cache line of memory of the caller's. */
static inline void *ordernm_line(scalar *room)
{
    char *const at = (char *)room;
    return at + (64 - (size_t)at%64)%64;
}

enum { LANES = 8, MOST_STAGES = 16 };
enum { ORDERNM_SIDES = 12 };  /* rates are sampled at this many places beside a point, see points.c */
enum { HALVES = 40 };         /* how often a time is halved in which rates may jump */

/* Directions that are evaluated together. */
typedef struct {
    int width, index;         /* 1, 4 or 8 lanes; which of the functions of a system */
    int first, used;          /* the first of its directions, and how many lanes have one */
    long at;                  /* where its derivatives begin in z */
    scalar *dp;               /* [np][width] */
} group;

/* A sum of rates: z + h*sum(factor*rate[which]). */
typedef struct {
    int count;
    int which[MOST_STAGES];
    scalar factor[MOST_STAGES];
} row;

/* What a method does, from z, and rate[0] there, to next. */
typedef struct {
    int stages;               /* of a step; the next rate is that at its end */
    int all;                  /* with those that the interpolant needs */
    int order;                /* errors of a step are proportional to the step to its power */
    int (*step)(ordernm_motion *m, scalar h, scalar *error);                   /* 1 is the largest error allowed */
    int (*complete)(ordernm_motion *m, scalar h);                              /* the further stages */
    void (*interpolate)(ordernm_motion *m, scalar h, scalar theta, scalar *z); /* at t + theta h */
    /* of explicit methods */
    const row *rows;          /* what stages are; that of number `stages` is the step's end */
    const scalar *times;      /* of stages, in steps */
    void (*weights)(scalar theta, scalar *factor); /* of all rates, at t + theta h */
    int gives_rate;           /* a step leaves the rate at its end in rate[stages] */
    scalar gap;               /* the place in a step that is farthest from all stages; 0: conditions of stages are not kept */
    void (*keep)(const ordernm_motion *m, scalar *row); /* what the way back needs of a step: its row, behind the state */
} scheme;

/* A function of a system, as it is to be called at the state whose loops were closed last. */
#define ORDERNM_OF(m, function) ((m)->precise ? (m)->system->precise->function : (m)->system->function)
#define ORDERNM_VALUES_OF(m, function) ((m)->precise_values ? (m)->system->precise->function : (m)->system->function)

/* A step that is tried. */
typedef struct {
    scalar h, end;            /* its size, and the time at its end */
    scalar wall, knot;        /* where it may not go beyond; the next knot of the inputs */
    int to_wall, to_pose;     /* it ends at the wall; it is shorter than it might be, because of a pose */
    int again;                /* a stage was too near to a pose */
    int at_pose;              /* it ends where a loop has lost rank, and so does the motion */
    int apart;                /* behind it a dropped condition is open by too much */
    scalar dead;              /* where in it the independent coordinates have a dead point, in parts of it; else 0 */
    scalar error;             /* in units of what is allowed */
    int event;                /* that ends it; -1 for none */
    scalar event_time;        /* when that is */
} trial;

struct ordernm_motion {
    const ordernm_problem *problem;
    const ordernm_system *system;
    const scheme *method;
    int ny, nx, nd;           /* independent coordinates and speeds, integrals, dependent coordinates */
    int identity;             /* all are independent: arrays of z are those of the system */
    long values, size;        /* doubles of z without and with derivatives */
    int ngroups;
    group *groups;
    int *dependent;           /* [nd] coordinates */
    int *turned;              /* [nquaternions] whether one is dependent */
    scalar *lengths;          /* [nquaternions] before loops are closed */
    scalar *z, *next;         /* at the step's beginning and end */
    scalar *rate[MOST_STAGES];
    scalar *trial, *zeros, *error[2];
    scalar *work, *q, *u, *qdot, *udot, *newton, *position, *condition, *outputs, *inputs;
    scalar *dq, *du, *dqdot, *dudot, *full_dq, *full_du, *doutputs, *dinputs;
    scalar *dt;               /* [LANES]; of seeds zeros, for time has no derivative here; transposes write there */
    scalar *row;
    scalar *stages;           /* states of the stages behind the first, of explicit methods: values, coordinates with loops closed */
    void *precise_work;
    scalar poor;              /* condition from which on loops are closed, and rates computed, in long double ... */
    scalar poor_rates;        /* ... and from which on derivatives are, of rates and outputs, and rows of results */
    int derived;              /* derivatives are taken, of this motion or of steps that it keeps ... */
    scalar best;              /* ... and the least condition at the beginning of a step so far */
    int precise;              /* derivatives are at the state whose loops were closed last */
    int precise_values;       /* and so are rates themselves: else they are as in a motion without derivatives, as fast */
    int precise_at_end;       /* they were at the end of the step that was tried */
    unsigned precise_stages;  /* they were at the stages of a step, a bit for each */
    scalar too_poor;          /* condition that no stage should have: not even then is rounding less than what is allowed */
    scalar telling;           /* condition from which on a stage should not be near to the pose that makes it so */
    scalar *closed;           /* [nq] coordinates at the end of the step that was tried, loops closed, if that is known */
    scalar closed_condition;
    int closed_known;
    scalar conditions[MOST_STAGES]; /* of the stages of a step, and at its end */
    scalar *ranks;            /* [MOST_STAGES][nloops] the same of each loop: inverse conditions */
    scalar *ranks_between;    /* as above, at places between them */
    scalar apart, apart_at_end; /* by how much dropped conditions are open: of the loops closed last, at the end of the step tried */
    int widest;               /* the one that is open most */
    scalar *flat;             /* [1 + 2 nq] a pose that the step passes, as in results; its time is -INFINITY if there is none */
    scalar calm_rank, calm_growth; /* inverse condition, and growth of dependent speeds, at the beginning of an approach; see dead_points.c */
    scalar shorter;           /* the next step's size, where it is to end before a dead point; else 0 */
    int refused;              /* how often a step has been made again because of a dead point */
    scalar hopeless;          /* condition from which on results are those beside the pose */
    scalar *known_row, *beside; /* such a row, and those that it is made of */
    scalar *at_pose;          /* a state like that */
    scalar *probe[5];         /* [values]; see ordernm_undetermined */
    int row_known;
    scalar pose;              /* when a loop will lose rank, as far as that is known; else -INFINITY */
    scalar refused_pose, refused_step, refused_error; /* of the last step across a pose whose error was too large */
    scalar mark;              /* where it was some steps ago */
    long marked;              /* how many it had made then */
    scalar looked_at;         /* see ordernm_problem */
    int moved;                /* how often a step has been made again with stages elsewhere */
    int imprecise;            /* that was wanted, and could not be done */
    /* where it is */
    scalar t, h;
    long segment;             /* of the inputs' spline in this step */
    long sampled;             /* of the times that results are wanted at */
    int stopped;              /* at an event */
    int begun, adaptive, rejected_before, complete;
    scalar *crossing, *after, *within; /* [nevents] at the step's beginning, at its end, in between */
    scalar *part;             /* [nevents] of the step, at which an event happens */
    scalar *happened, *paces; /* [nevents] 1.0 if the step ends there; how fast outputs change in the step on the whole */
    scalar *at_first;         /* [nevents] outputs, as above, at the first event of the step */
    scalar *samples;          /* outputs between the ends of the step, as above */
    scalar around_event[2];   /* times in the step between which the event is that ends it */
    scalar beside_event[2];   /* one of them, and the output there */
    scalar error_to_event;    /* of the step that has been made again to it */
    int root;                 /* the switch at whose zero the step that is tried ends or begins, see powers.c; -1 for none, MANY_ROOTS */
    int beside_power;         /* rates may change as steeply there as if they jumped */
    scalar root_end;          /* when the last such step has ended; else -INFINITY */
    ordernm_results *results;
    scalar stable;            /* most by which stability lets the next step be longer, where derivatives are taken */
    scalar *fast, growth;     /* the direction in which rates change most, and by how much more than it in the step before */
    int fast_steps;           /* in which that is still looked at */
    int far_steps, near_steps; /* in a row, in which an explicit method was at its limit of stability, and was not */
    scalar error_before;      /* of the step before, as a share of what is allowed; 0 at the beginning */
    scalar advice;            /* how many times as large the next step should be, 0: as its error says */
    struct radau *radau;      /* what that method has of its own, else 0 */
    /* switches */
    int nheld, nwatched;      /* switches whose modes are held; with events, what is looked for within a step */
    int *held;                /* [nheld] which ones */
    scalar *modes, *switches; /* [nswitches] their modes, and switching functions */
    scalar *crossed;          /* [nswitches] how fast functions change in the step before that has ended at their zero; else 0 */
    scalar *dswitches, *switch_along; /* [nswitches][LANES]; [ngroups][LANES] */
    scalar *input_rates, *no_dp; /* [ninputs]; zeros, [np] */
    scalar *changed;          /* [nswitches] when modes changed last */
    scalar accumulating;      /* when the passing of switches that is counted began ... */
    long passed;              /* ... and how often switches have been passed since */
    int last_passed;          /* the switch that was passed last */
    scalar *let_go;           /* [nswitches] modes before they were let go for a step; else 0 */
    int not_held;             /* steps in a row that were refused because held rates have no value */
    scalar *passing_time;     /* [ngroups][LANES] derivatives of the time of the switch that was passed last ... */
    scalar *switch_time;      /* ... and of the last one in an output that an event is of */
    scalar *speeds;           /* [nswitches] how fast functions of switches with a jump changed before they were passed; else 0 */
    int ntogether, *together; /* switches that have been passed at one time, in this order ... */
    int together_jump;        /* ... with a jump of rates ... */
    scalar together_since, *z_before, *modes_before, *switches_kept; /* ... since when, from which state and modes; room for modes */
    scalar *lost;             /* [ngroups][LANES] NaN: there is no derivative along the direction any more; else 0 */
    int *resting;             /* [nswitches] room for those that the motion rests at */
    int npoints;              /* singular functions that are looked for */
    scalar *singular;         /* [5][nswitches] what they are within the step */
    scalar *sides[ORDERNM_SIDES]; /* [size] rates on both sides of such a point, see points.c */
    scalar *at_point;         /* [size] the state at it */
    scalar *moved_p;          /* [np] parameters beside it */
    const scalar *p;          /* parameters: the problem's, or those */
    scalar *halves[HALVES + 1]; /* [values] rates at these times, and how much a jump is at least */
    int suspects;             /* steps in which rates may jump without a switch */
    int jumps_at_end;         /* they seem to at the end of this one */
    scalar turning;           /* the longest step in which no angle that jumps at half a turn leaves its mode by so much; 0 for any */
    int switched;             /* modes have changed between the step before and this one */
    long head;                /* numbers of a row of steps before the state */
};

static inline void ordernm_note_precise(ordernm_motion *m, int stage)
{
    m->precise_stages = (m->precise_stages & ~(1u << stage)) | (unsigned)m->precise << stage;
}

/* What switching functions are at least on the side that they have just come to, whatever rounding says. */
static const scalar LEAST_SIDE = 1e-300;
/* Switches that follow each other within this part of the motion's time are passed at the same time: no tolerance tells their order. */
static const scalar AT_THE_SAME_TIME = 1e-9;

/* Derivatives behind several switches that differ by more between two orders, relative to their jumps, depend on the order. */
static const scalar ORDER_MATTERS = 1e-6;

enum { SLIDES = -1000 };      /* beside what functions return: a switch is pushed back to from both sides */

/* sums.c */
void ordernm_combine(long n, scalar *out, const scalar *z, scalar h, int count, const int *which, const scalar *factor,
    scalar *const *rate);
int ordernm_all_finite(const scalar *x, long n);
int ordernm_finite_along(const scalar *S, long n, int width, int lane);

/* sizes.c; those of rows are in motion.h */
enum { RK4_STAGES = 4, DOP853_STAGES = 12, RADAU_STAGES = 3 };
int ordernm_kind(const ordernm_problem *p);
static inline long ordernm_whole_lines(long n) { return (n + 7)/8*8; }

/* inputs.c */
enum { ORDERNM_ORDERS = 3 };  /* of time derivatives of inputs: the value, the rate, the acceleration */
static inline int ordernm_signals(const ordernm_system *s) { return s->ninputs - 2*s->nmoving; }
void ordernm_find_segment(ordernm_motion *m, scalar t, scalar h);
scalar ordernm_next_knot(const ordernm_motion *m, scalar t);
long ordernm_input_weights(const ordernm_motion *m, scalar t, scalar value[ORDERNM_ORDERS][ORDERNM_MOST_DEGREE + 1]);
int ordernm_signal_of(const ordernm_system *s, int input, int *order);
void ordernm_input_rates(ordernm_motion *m, scalar t, scalar *rates);
const scalar *ordernm_inputs_at(ordernm_motion *m, scalar t);
scalar *ordernm_input_directions(ordernm_motion *m, scalar t, const group *g);

/* state.c */
enum { RATES = 1, INTEGRALS = 2, KNOWN_CLOSED = 4, PRECISE = 8 }; /* of the state; of integrals; loops are known to be closed, and poor */
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

/* errors.c */
int ordernm_counted(const ordernm_motion *m);
scalar ordernm_error_norm(const ordernm_motion *m, const scalar *next, const scalar *error, const scalar *second);
void ordernm_note_coarse(ordernm_motion *m, scalar h);
int ordernm_worst_entry(const ordernm_motion *m);

/* explicit.c, radau.c */
extern const scheme ordernm_rk4, ordernm_dop853, ordernm_radau;
void ordernm_keep_stage(ordernm_motion *m, int stage);
size_t ordernm_radau_layout(ordernm_motion *m, void *at);
size_t ordernm_radau_layout_stages(ordernm_motion *m, int n, void *at);

/* dead_points.c */
enum { RANKS_BETWEEN = 35 }; /* places that are looked at together */
int ordernm_jumped(const ordernm_motion *m, const scalar *z);
int ordernm_undetermined(ordernm_motion *m);
scalar ordernm_dead_point_within(ordernm_motion *m, scalar h);

/* poses.c */
static const scalar LOST = 1e300; /* condition where rank is lost */
typedef int ordernm_describing(ordernm_motion *m, scalar t, const scalar *z, scalar *row);
enum { BESIDE = 6 };
int ordernm_find_pose(ordernm_motion *m, scalar h);
int ordernm_rounded_at_pose(const ordernm_motion *m, scalar h, scalar error);
int ordernm_beside(ordernm_motion *m, scalar h, ordernm_describing *describe, long size);
int ordernm_beside_within(ordernm_motion *m, scalar h, scalar part, long size);
scalar ordernm_step_at_pose(const ordernm_motion *m, scalar h, scalar wall);

/* events.c */
enum { EVENT_SAMPLES = 7 };  /* between the ends of a step */
int ordernm_crossings(ordernm_motion *m, scalar t, const scalar *z, scalar *g);
int ordernm_look_for_events(ordernm_motion *m, trial *step);
int ordernm_keep_events(ordernm_motion *m, const trial *step, int *stop);
int ordernm_compare_events(ordernm_motion *m);
int ordernm_jumped_events(ordernm_motion *m, int by_state, int *stop);

/* switches.c */
int ordernm_switch_speed(ordernm_motion *m, scalar t, const scalar *z, const scalar *rate, int k, scalar *found);
int ordernm_timing_switch(ordernm_motion *m, scalar t, const scalar *z, const scalar *rate, const scalar *crossed, int k, scalar *speed,
    int *by);
int ordernm_switch_along(ordernm_motion *m, scalar t, const scalar *z, int k);
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
void ordernm_touch(ordernm_motion *m, scalar t, int k);
int ordernm_follow_inputs(ordernm_motion *m);
void ordernm_keep_modes(const ordernm_motion *m, scalar *row);
void ordernm_take_modes(ordernm_motion *m, const scalar *row);

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
    int which;                /* the singular function */
    scalar part;              /* of the step, where it is zero */
    int before, after;        /* rates on this side have the modes at hand */
} point;
void ordernm_between(const ordernm_motion *m, scalar h, scalar x, scalar *z);
int ordernm_next_point(ordernm_motion *m, const trial *step, point *found);
int ordernm_look_at_point(ordernm_motion *m, scalar h, const point *at);
int ordernm_rates_are_rough(const ordernm_motion *m, scalar h, const point *at);
int ordernm_lost_at_point(ordernm_motion *m, scalar h, const point *at, int n, int lane);

/* powers.c */
enum { MANY_ROOTS = -2 };
int ordernm_beside_root(ordernm_motion *m, const trial *step);
scalar ordernm_error_beside_powers(ordernm_motion *m, const trial *step, scalar error);
int ordernm_growing_power(ordernm_motion *m, const trial *step);

/* lost.c */
void ordernm_lose_infinite(ordernm_motion *m, const scalar *z);
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
