/* Functions of a solver as external functions of CasADi: values, directions, adjoints, Jacobians and Hessian products.
 *
 * Every function is described by constants. All scratch memory lies in CasADi's work vector, so calls are re-entrant. */
#ifndef ORDERNM_CASADI_EXTERNAL_H
#define ORDERNM_CASADI_EXTERNAL_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

typedef long long ordernm_int; /* casadi_int */

enum { ORDERNM_LANES = 8, ORDERNM_ARGUMENTS = 8, ORDERNM_TRIES = 400, ORDERNM_ROUNDS = 12 };

/* Arrays by argument: whole arrays of the model; seeds have one value of each entry for every direction. */
typedef const double *const *ordernm_given;
typedef double *const *ordernm_found;

/* Loops are closed along a straight line from the initial state, in steps within which Newton's method contracts. */
typedef struct {
    int (*step)(ordernm_given x, double *step, double *work);
    const double *const *start; /* the initial state, by argument */
    const double *scale;        /* unit of change of each coordinate */
    const int *quaternions;
    int n_quaternions, n_q;
} ordernm_loops;

typedef struct {
    int n_in, n_out;         /* number of arguments; number of entries of the result */
    const int *size, *whole; /* entries of each argument, and of its whole array */
    const int *const *place; /* index of each entry in the whole array; 0 if the argument is the whole array */
    int n_whole;             /* entries of all whole arrays */
    ptrdiff_t workspace;     /* doubles in the workspace of the generated functions */
    const ordernm_loops *loops;
    int (*value)(ordernm_given x, double *y, double *work);
    int (*along_1)(ordernm_given x, ordernm_given dx, double *y, double *dy, double *work);
    int (*along_8)(ordernm_given x, ordernm_given dx, double *y, double *dy, double *work);
    int (*back_1)(ordernm_given x, const double *weights, double *y, ordernm_found g, double *work);
    int (*products_8)(ordernm_given x, const double *weights, ordernm_given dx, ordernm_found dg, double *work);
    const ordernm_int *const *jacobian; /* patterns of the blocks, by argument */
    const ordernm_int *const *hessian;  /* the same, by the argument of the rows, then that of the columns */
    const int *const *transposed;       /* place of each entry of a Jacobian in the transposed pattern */
} ordernm_function;

typedef struct {
    const double *x[ORDERNM_ARGUMENTS];  /* whole arrays */
    double *dx[ORDERNM_ARGUMENTS];       /* seeds */
    double *g[ORDERNM_ARGUMENTS];        /* gradients, or their changes */
    double *y, *dy, *weights, *work;
} ordernm_call;

/* Number of doubles in CasADi's work vector. */
static ordernm_int ordernm_size(const ordernm_function *f)
{
    return (ordernm_int)(f->n_whole * (1 + 2 * ORDERNM_LANES) + f->n_out * (2 + ORDERNM_LANES) + f->workspace);
}

static void ordernm_normalise(const ordernm_loops *loops, double *q)
{
    for (int k = 0; k < loops->n_quaternions; ++k) {
        double *e = q + loops->quaternions[k];
        const double length = sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + e[3] * e[3]);
        for (int i = 0; i < 4; ++i) e[i] /= length;
    }
}

/* Newton's method from q. Returns 0 if its first step is at most 0.3 rad and each next step is at most a quarter of the previous one; the
 * solver's own assembly has the same bounds. Between the ends of the line a rough solution is enough. */
static int ordernm_newton(const ordernm_loops *loops, ordernm_given x, double *q, double *step, double enough, double *work)
{
    double before = 1.2;
    for (int round = 0; round < ORDERNM_ROUNDS; ++round) {
        double size = 0.0, left;
        if (loops->step(x, step, work)) return 1;
        for (int i = 0; i < loops->n_q; ++i) size = fmax(size, fabs(step[i] / loops->scale[i]));
        if (!(size <= 0.25 * before || size <= 1e-12)) return 1;
        for (int i = 0; i < loops->n_q; ++i) q[i] += step[i];
        ordernm_normalise(loops, q);
        left = size * (size / before) * (size / before); /* the next step, as convergence is quadratic */
        if (size <= enough || left <= 1e-15) return 0;
        before = size;
    }
    return 1;
}

/* Closes the loops at the end of the line: the whole arrays of `at` get its coordinates. */
static int ordernm_close(const ordernm_function *f, const double *const *arg, double *const *at, double *scratch, double *work)
{
    const ordernm_loops *loops = f->loops;
    double *const step = scratch, *const kept = scratch + loops->n_q, s_least = 1e-6;
    double s = 0.0, h = 1.0;
    memcpy(kept, loops->start[0], sizeof(double) * (size_t)loops->n_q);
    for (int n = 0; n < ORDERNM_TRIES; ++n) {
        const double to = h >= 1.0 - s ? 1.0 : s + h;
        memcpy(at[0], kept, sizeof(double) * (size_t)loops->n_q);
        for (int i = 0; i < f->n_in; ++i)
            for (int j = 0; loops->start[i] && j < f->size[i]; ++j) {
                const int k = f->place[i] ? f->place[i][j] : j;
                const double end = arg[i] ? arg[i][j] : 0.0;
                at[i][k] = to == 1.0 ? end : loops->start[i][k] + to * (end - loops->start[i][k]);
            }
        ordernm_normalise(loops, at[0]);
        if (ordernm_newton(loops, (ordernm_given)at, at[0], step, to == 1.0 ? 1e-10 : 1e-3, work)) {
            h *= 0.4;
            if (h < s_least) return 1;
        } else if (to == 1.0) {
            return 0;
        } else {
            memcpy(kept, at[0], sizeof(double) * (size_t)loops->n_q);
            s = to;
            h *= 2.0;
        }
    }
    return 1;
}

/* Places all arrays in the work vector, and completes the arguments. */
static int ordernm_begin(const ordernm_function *f, const double **arg, double *w, ordernm_call *call)
{
    double *at[ORDERNM_ARGUMENTS] = {0};
    for (int i = 0; i < f->n_in; ++i) {
        at[i] = w, w += f->whole[i];
        call->dx[i] = w, w += f->whole[i] * ORDERNM_LANES;
        call->g[i] = w, w += f->whole[i] * ORDERNM_LANES;
    }
    call->y = w, w += f->n_out;
    call->weights = w, w += f->n_out;
    call->dy = w, w += f->n_out * ORDERNM_LANES;
    call->work = w;
    if (f->loops && ordernm_close(f, arg, at, call->dx[0], call->work)) return 1;
    for (int i = 0; i < f->n_in; ++i) {
        call->x[i] = at[i];
        if (f->loops && f->loops->start[i]) continue; /* closing the loops wrote it */
        if (!f->place[i] && arg[i]) {
            call->x[i] = arg[i];
            continue;
        }
        memset(at[i], 0, sizeof(double) * (size_t)f->whole[i]);
        for (int j = 0; arg[i] && j < f->size[i]; ++j) at[i][f->place[i] ? f->place[i][j] : j] = arg[i][j];
    }
    return 0;
}

static int ordernm_place(const ordernm_function *f, int i, int j)
{
    return f->place[i] ? f->place[i][j] : j;
}

static void ordernm_no_seeds(const ordernm_function *f, ordernm_call *call)
{
    for (int i = 0; i < f->n_in; ++i) memset(call->dx[i], 0, sizeof(double) * (size_t)(f->whole[i] * ORDERNM_LANES));
}

static int ordernm_value(const ordernm_function *f, const double **arg, double **res, double *w)
{
    ordernm_call call;
    if (!res[0]) return 0;
    return ordernm_begin(f, arg, w, &call) || f->value(call.x, res[0], call.work);
}

/* Derivatives along n directions. In `arg`, the seeds follow the arguments and the result, one column for each direction. */
static int ordernm_forward(const ordernm_function *f, int n, const double **arg, double **res, double *w)
{
    ordernm_call call;
    const int lanes = n == 1 ? 1 : ORDERNM_LANES;
    if (!res[0]) return 0;
    if (ordernm_begin(f, arg, w, &call)) return 1;
    ordernm_no_seeds(f, &call);
    for (int i = 0; i < f->n_in; ++i) {
        const double *seed = arg[f->n_in + 1 + i];
        for (int d = 0; seed && d < n; ++d)
            for (int j = 0; j < f->size[i]; ++j)
                call.dx[i][ordernm_place(f, i, j) * lanes + d] = seed[d * f->size[i] + j];
    }
    if ((n == 1 ? f->along_1 : f->along_8)(call.x, (ordernm_given)call.dx, call.y, call.dy, call.work)) return 1;
    for (int d = 0; d < n; ++d)
        for (int i = 0; i < f->n_out; ++i) res[0][d * f->n_out + i] = call.dy[i * lanes + d];
    return 0;
}

/* Progress through the columns of the requested blocks, and the group of columns whose unit seeds are set. */
typedef struct {
    int i, j, count;
    int argument[ORDERNM_LANES], entry[ORDERNM_LANES];
} ordernm_columns;

/* Replaces the unit seeds by those of the next group of columns; returns their number. */
static int ordernm_next(const ordernm_function *f, const int *wanted, ordernm_columns *c, ordernm_call *call)
{
    for (int d = 0; d < c->count; ++d)
        call->dx[c->argument[d]][ordernm_place(f, c->argument[d], c->entry[d]) * ORDERNM_LANES + d] = 0.0;
    c->count = 0;
    for (; c->i < f->n_in; ++c->i, c->j = 0)
        for (; wanted[c->i] && c->j < f->size[c->i]; ++c->j) {
            if (c->count == ORDERNM_LANES) return c->count;
            c->argument[c->count] = c->i, c->entry[c->count] = c->j;
            call->dx[c->i][ordernm_place(f, c->i, c->j) * ORDERNM_LANES + c->count++] = 1.0;
        }
    return c->count;
}

/* Jacobians of the result with respect to each requested argument. */
static int ordernm_columns_of(const ordernm_function *f, ordernm_call *call, double *const *blocks)
{
    ordernm_columns c = {0};
    int wanted[ORDERNM_ARGUMENTS];
    for (int i = 0; i < f->n_in; ++i) wanted[i] = blocks[i] != 0;
    ordernm_no_seeds(f, call);
    while (ordernm_next(f, wanted, &c, call)) {
        if (f->along_8(call->x, (ordernm_given)call->dx, call->y, call->dy, call->work)) return 1;
        for (int d = 0; d < c.count; ++d) {
            const ordernm_int *pattern = f->jacobian[c.argument[d]], *first = pattern + 2;
            const ordernm_int *row = first + pattern[1] + 1;
            for (ordernm_int k = first[c.entry[d]]; k < first[c.entry[d] + 1]; ++k)
                blocks[c.argument[d]][k] = call->dy[row[k] * ORDERNM_LANES + d];
        }
    }
    return 0;
}

static int ordernm_jacobian(const ordernm_function *f, const double **arg, double **res, double *w)
{
    ordernm_call call;
    return ordernm_begin(f, arg, w, &call) || ordernm_columns_of(f, &call, res);
}

/* The gradient of weights . result with respect to the whole arrays, in the first entries of call->g. */
static int ordernm_gradient(const ordernm_function *f, ordernm_call *call, const double *weights)
{
    ordernm_columns c = {0};
    int wanted[ORDERNM_ARGUMENTS];
    for (int i = 0; i < f->n_in; ++i) memset(call->g[i], 0, sizeof(double) * (size_t)f->whole[i]);
    if (f->back_1) return f->back_1(call->x, weights, call->y, (ordernm_found)call->g, call->work);
    for (int i = 0; i < f->n_in; ++i) wanted[i] = 1;
    ordernm_no_seeds(f, call);
    while (ordernm_next(f, wanted, &c, call)) {
        if (f->along_8(call->x, (ordernm_given)call->dx, call->y, call->dy, call->work)) return 1;
        for (int d = 0; d < c.count; ++d) {
            double sum = 0.0;
            for (int k = 0; k < f->n_out; ++k) sum += weights[k] * call->dy[k * ORDERNM_LANES + d];
            call->g[c.argument[d]][ordernm_place(f, c.argument[d], c.entry[d])] = sum;
        }
    }
    return 0;
}

/* Gradients for n vectors of weights. In `arg`, the weights follow the arguments and the result. */
static int ordernm_adjoint(const ordernm_function *f, int n, const double **arg, double **res, double *w)
{
    ordernm_call call;
    const double *weights = arg[f->n_in + 1];
    if (ordernm_begin(f, arg, w, &call)) return 1;
    for (int d = 0; d < n; ++d) {
        for (int k = 0; k < f->n_out; ++k) call.weights[k] = weights ? weights[d * f->n_out + k] : 0.0;
        if (ordernm_gradient(f, &call, call.weights)) return 1;
        for (int i = 0; i < f->n_in; ++i)
            for (int j = 0; res[i] && j < f->size[i]; ++j)
                res[i][d * f->size[i] + j] = call.g[i][ordernm_place(f, i, j)];
    }
    return 0;
}

/* The Jacobian of the adjoint: Hessians of weights . result, and the transposed Jacobian. Blocks for the result are empty. */
static int ordernm_hessian(const ordernm_function *f, const double **arg, double **res, double *w)
{
    ordernm_call call;
    ordernm_columns c = {0};
    const double *weights = arg[f->n_in + 1];
    const int n = f->n_in + 2;
    int wanted[ORDERNM_ARGUMENTS] = {0}, by_weights[ORDERNM_ARGUMENTS], any = 0;
    if (ordernm_begin(f, arg, w, &call)) return 1;
    for (int k = 0; k < f->n_out; ++k) call.weights[k] = weights ? weights[k] : 0.0;
    for (int i = 0; i < f->n_in; ++i) {
        any |= by_weights[i] = res[i * n + n - 1] != 0;
        for (int j = 0; j < f->n_in; ++j) wanted[j] |= res[i * n + j] != 0;
    }
    ordernm_no_seeds(f, &call);
    while (ordernm_next(f, wanted, &c, &call)) {
        if (f->products_8(call.x, call.weights, (ordernm_given)call.dx, (ordernm_found)call.g, call.work)) return 1;
        for (int d = 0; d < c.count; ++d)
            for (int i = 0; i < f->n_in; ++i) {
                double *block = res[i * n + c.argument[d]];
                const ordernm_int *pattern = f->hessian[i * f->n_in + c.argument[d]], *first = pattern + 2;
                const ordernm_int *row = first + pattern[1] + 1;
                for (ordernm_int k = first[c.entry[d]]; block && k < first[c.entry[d] + 1]; ++k)
                    block[k] = call.g[i][ordernm_place(f, i, (int)row[k]) * ORDERNM_LANES + d];
            }
    }
    if (!any) return 0;
    c = (ordernm_columns){0};
    ordernm_no_seeds(f, &call);
    while (ordernm_next(f, by_weights, &c, &call)) {
        if (f->along_8(call.x, (ordernm_given)call.dx, call.y, call.dy, call.work)) return 1;
        for (int d = 0; d < c.count; ++d) { /* a column of the Jacobian is a row of its transpose */
            const ordernm_int *pattern = f->jacobian[c.argument[d]], *first = pattern + 2;
            const ordernm_int *row = first + pattern[1] + 1;
            double *block = res[c.argument[d] * n + n - 1];
            for (ordernm_int k = first[c.entry[d]]; k < first[c.entry[d] + 1]; ++k)
                block[f->transposed[c.argument[d]][k]] = call.dy[row[k] * ORDERNM_LANES + d];
        }
    }
    return 0;
}

#endif
