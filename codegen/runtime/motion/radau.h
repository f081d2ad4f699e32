/* Shared by the files of Radau IIA. */
#ifndef ORDERNM_RADAU_H
#define ORDERNM_RADAU_H

#include "inside.h"
#include "linear.h"
#include "radau_tables.h"

/* Unknowns of the equations, and coordinates that are eliminated because their rates are speeds. */
typedef struct {
    int order, count;
    int *kept, *place;        /* [order] retained entries; [n] index of each entry among them */
    int *reduced, *partner;   /* [count] eliminated entries; indices of their rates */
} reduction;

struct radau {
    int n;                    /* number of independent coordinates and speeds */
    int nq;                   /* number of coordinates among them */
    reduction of_step, of_stages;
    scalar *column;           /* [order][count] of -J */
    scalar *jacobian;         /* [n][n] */
    int formed;               /* whether Jacobians at the three stages are formed in every step */
    scalar *at_stage[STAGES], *along[STAGES]; /* [n][n] Jacobians at the stages; [n][LANES] derivatives of rates along those of z */
    scalar *whole, *of_whole; /* [3 n][3 n] factors of the equations of all three stages, [3 n][LANES] their solutions */
    int *whole_pivot;
    scalar *real, *re, *im;   /* factors of REAL/h - J and (RE + i IM)/h - J */
    int *real_pivot, *pivot;  /* row exchanges */
    scalar h_factored;        /* step size of the factors; 0: no factors are available */
    group columns;            /* seeds of J's columns, several at a time */
    scalar *seeded, *seeded_rate;
    scalar *stage[STAGES], *last[STAGES]; /* Z of this step, and of the last accepted one */
    scalar *right[STAGES], *scratch[5];   /* [n][LANES] */
    scalar *scale;            /* [n] tolerances */
    scalar *infinite;         /* [n] 1 for columns of the stages' Jacobians with entries that were not finite, and were set to zero */
    int tried, jacobian_here; /* jacobian_here: J was computed at z */
    int formed_here;          /* the Jacobian at z is known: it was formed at the last stage of the previous step */
    long segment;             /* piece of the inputs' spline in the last tried step */
    long accepted;            /* number of accepted steps with a stored Z */
    scalar h_last, h_tried, t_tried;
    scalar leniency;          /* largest accepted error estimate, relative to the tolerance of the solution */
    scalar slowness, sweep_slowness; /* theta/(1 - theta), theta the convergence rate of Newton's method, or of sweeps */
    scalar flow_slowness;     /* the same number for sweeps along the motion itself */
    scalar slowness_before;   /* slowness at the start of Newton's method in this step */
    scalar *of_jacobian;      /* [values] the state at which J was computed */
    scalar t_of_jacobian;
    long segment_of_jacobian;
    scalar theta;
    int iterations;
    scalar error_accepted, h_accepted;
};

enum { CONVERGED = -100, DIVERGED, INFINITE }; /* in addition to the status of functions */

static inline scalar ordernm_time_of_stage(scalar t, scalar h, int i) { return i == STAGES - 1 ? t + h : t + TIME[i]*h; }

/* The transposed equations of the stages, see radau_transposed.c. Right sides become residuals; `at` is the position of their entries,
 * [n][width], in the arrays of adjoints. */
typedef struct ordernm_transposed {
    ordernm_motion *motion;
    scalar h;
    int width;
    long at;
    scalar *const *stage;     /* states at the stages, loops closed */
    scalar *const *right, *const *change, *const *mu; /* right sides; scratch; the solution */
    scalar *lambda, *nu;      /* the adjoint at the start of the step; scratch */
    void *of;                 /* data of the function: */
    int (*rates_transposed)(const struct ordernm_transposed *equations, int i); /* nu = f_z^T change at a stage, and adds to the gradients */
} ordernm_transposed;

/* radau.c */
void ordernm_radau_weights(scalar theta, scalar *w);
int ordernm_radau_replay(ordernm_motion *m, const scalar *known, scalar *row);

/* radau_equations.c */
int ordernm_radau_rates(ordernm_motion *m, scalar h, int i, const group *g, int beginning, int what);
int ordernm_radau_differentiate(ordernm_motion *m, scalar t, const scalar *z, scalar *jacobian, int precise);
void ordernm_radau_take_jacobian(struct radau *r);
int ordernm_radau_factorise(ordernm_motion *m, scalar h);
void ordernm_radau_solve_real(const struct radau *r, scalar *b, int width);
void ordernm_radau_correct(ordernm_motion *m, scalar h, long at, int width);
void ordernm_radau_precondition_transposed(const struct radau *r, scalar *const *right, scalar *const *mu, int width);
int ordernm_radau_factorise_stages(struct radau *r, scalar h);
void ordernm_radau_solve_stages(ordernm_motion *m, scalar h, long at, int width);
void ordernm_radau_solve_transposed(const struct radau *r, scalar h, scalar *const *mu, int width);

/* radau_transposed.c */
int ordernm_radau_solve_adjoint(const ordernm_transposed *equations);

/* radau_sensitivities.c */
int ordernm_radau_along(ordernm_motion *m, scalar h, const group *g, int closed, int *formed);

#endif
