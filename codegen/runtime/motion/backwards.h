/* Shared by the files of the adjoint: a step of a method, and one state, with the transposes of the generated functions. */
#ifndef ORDERNM_BACKWARDS_H
#define ORDERNM_BACKWARDS_H

#include "inside.h"

struct ordernm_adjoint {
    ordernm_problem problem;          /* the motion's problem without directions */
    ordernm_results none;
    ordernm_gradients *gradients;
    ordernm_motion *motion;
    int width, index, ngroups;        /* functionals per group; index of the functions for them; groups */
    int n;                            /* number of integrated entries with derivatives */
    long *sampled, behind;            /* numbers of times still to process: output times by group, times after jumps */
    long timed;                       /* index, among times after jumps, of the one that the switch processed next determines; -1: none */
    scalar *lambda;                   /* [ngroups][n][width] */
    scalar *kappa[MOST_STAGES], *nu;  /* [n][width] */
    scalar *stage[MOST_STAGES], *q[MOST_STAGES]; /* states, and coordinates with closed loops */
    scalar *weights_q, *weights_u, *dq, *du, *dp, *dinputs, *weights;
    void *of_stages;                  /* memory of an implicit method for its equations */
    int has_next;                     /* whether a later step exists */
    scalar next_t, *next, *next_modes;/* time, state and modes at the start of the later step */
    scalar *p, *inputs;               /* gradients: [ngroups][np][width], [ngroups][count][nsignals][width] */
};

/* Whether a group has weights at times within this step, including its end. */
static inline int ordernm_samples_left(const ordernm_adjoint *a, int n)
{
    const long left = a->sampled[n];
    return left > 0 && a->gradients->times[left - 1] > a->motion->t;
}

static inline int ordernm_any(const scalar *x, long n)
{
    for (long i = 0; i < n; ++i)
        if (x[i] != 0.0) return 1;
    return 0;
}

static inline void ordernm_accumulate(scalar *to, scalar factor, const scalar *of, long n)
{
    for (long i = 0; i < n; ++i) to[i] += factor*of[i];
}

/* transposes.c; each returns the status of a function */
int ordernm_rates_transposed(ordernm_adjoint *a, int n, scalar t, const scalar *z, scalar *q, const scalar *kappa, scalar *nu);
int ordernm_integrals_transposed(ordernm_adjoint *a, int n, scalar t, const scalar *z, scalar *q, const scalar *kappa, scalar *nu);
int ordernm_sample_transposed(ordernm_adjoint *a, int n, scalar t, const scalar *z, scalar *nu);
int ordernm_switch_transposed(ordernm_adjoint *a, int n, scalar t, const scalar *z, int k, const scalar *jump, scalar speed,
    int timed);
int ordernm_settling_transposed(ordernm_adjoint *a, scalar t, const scalar *z);
int ordernm_sample_behind(ordernm_adjoint *a);
int ordernm_completion_transposed(ordernm_adjoint *a, int n, scalar *lambda);

/* switches_backwards.c */
int ordernm_switches_transposed(ordernm_adjoint *a, scalar t, const scalar *z, const scalar *row);
int ordernm_root_transposed(ordernm_adjoint *a, int k, scalar h);

/* explicit_backwards.c, radau_backwards.c, radau.c */
int ordernm_explicit_backwards(ordernm_adjoint *a, const scalar *row);
int ordernm_explicit_replay(ordernm_motion *m, int first, scalar *row);
int ordernm_radau_backwards(ordernm_adjoint *a, const scalar *row);
int ordernm_radau_replay(ordernm_motion *m, const scalar *known, scalar *row);

#endif
