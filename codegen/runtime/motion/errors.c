/* Errors of steps, relative to the tolerances. */
#include "inside.h"

#include <math.h>

/* The error of a constant step is estimated if two rates in the middle of the step differ by at least this number. The difference is
 * multiplied by the step size, and relative to the state. */
static const scalar LOOKED_AT = 1e-6;

/* Number of state entries with error control: integrated entries; if nothing is independent, also the predictions of dependent
 * coordinates. */
int ordernm_counted(const ordernm_motion *m)
{
    return m->ny + m->nx + (m->ny ? 0 : m->nd);
}

/* The mean square of n errors in tolerances. A tolerance is the absolute tolerance, plus the relative tolerance times the larger of two
 * magnitudes. */
static scalar mean_square(long n, long step, const scalar *error, const scalar *a, const scalar *b, const scalar *atol,
    int same, scalar rtol)
{
    scalar sum = 0.0;
    for (long i = 0; i < n; ++i) {
        const scalar x = fabs(a[i*step]), y = fabs(b[i*step]);
        const scalar of = error[i*step]/(atol[same ? 0 : i] + rtol*(x > y ? x : y));
        sum += of*of;
    }
    return n ? sum/n : 0.0;
}

/* An error of order 8 is about the square of an error of order 4, both relative to the state. In motions of all examples at tolerances from
 * 1e-6 to 1e-12, it is at least 0.01 to 0.02 of this square. Smaller estimates are small by chance: the signs of their terms cancel. */
static const scalar BY_CHANCE = 0.01;

/* Combines the mean squares of two error estimates as E. Hairer does: reduces the first estimate if the second is large. The result is at
 * least BY_CHANCE*rtol times the second estimate, which has order 4. */
static scalar of_both(scalar first, scalar second, scalar rtol)
{
    const scalar both = first + 0.01*second, least = BY_CHANCE*rtol*second;
    const scalar of = both > 0.0 || both != both ? first/sqrt(both) : 0.0;
    return of < least ? least : of;
}

/* The error of a step relative to the tolerance: the largest error of the state and of all directions. */
scalar ordernm_error_norm(const ordernm_motion *m, const scalar *next, const scalar *error, const scalar *second)
{
    const ordernm_problem *const p = m->problem;
    const long n = m->ny + m->nx, all = ordernm_counted(m);
    const scalar state = mean_square(all, 1, error, m->z, next, p->atol, 0, p->rtol);
    const scalar other = mean_square(all, 1, second, m->z, next, p->atol, 0, p->rtol);
    scalar largest = of_both(state, other, p->rtol);
    if (!p->atol_directions || !(largest == largest)) return largest;
    for (int g = 0; g < m->ngroups; ++g) {
        const group *const of = m->groups + g;
        for (int l = 0; l < of->used; ++l) {
            const scalar *const atol = p->atol_directions + of->first + l;
            const long at = of->at + l;
            const scalar one = mean_square(n, of->width, error + at, m->z + at, next + at, atol, 1, p->rtol);
            const scalar two = mean_square(n, of->width, second + at, m->z + at, next + at, atol, 1, p->rtol);
            largest = fmax(largest, of_both(one, two, p->rtol)); /* fmax ignores an error that is not a number: that direction has no derivative */
        }
    }
    return largest;
}

/* The state entry whose error in the last tried step is the largest, or is not finite. */
int ordernm_worst_entry(const ordernm_motion *m)
{
    const ordernm_problem *const p = m->problem;
    int worst = 0;
    scalar largest = -1.0;
    for (int i = 0; i < ordernm_counted(m); ++i) {
        const scalar of = fabs(m->error[0][i])/(p->atol[i] + p->rtol*fabs(m->z[i]));
        if (!(of <= largest)) largest = of, worst = i;
        if (of != of) break;
    }
    return worst;
}

/* Two quadratures of the interpolant's rates: places within a step, and factors at its start, at these places and at its end. */
enum { PLACES = 3 };
typedef struct {
    int count;
    scalar place[PLACES], factor[PLACES + 2];
} quadrature;

static const quadrature simpson = {1, {0.5}, {1.0/6.0, 4.0/6.0, 1.0/6.0}};
static const quadrature in_halves = {3, {0.25, 0.5, 0.75}, {1.0/12.0, 4.0/12.0, 2.0/12.0, 4.0/12.0, 1.0/12.0}};

/* The largest difference between a constant step and a quadrature, relative to the state. `entry`: the entry with this difference. */
static scalar difference(ordernm_motion *m, scalar h, const quadrature *of, int *entry)
{
    scalar *const *const k = m->rate, *const sum = m->error[0], *const rates = m->error[1], largest = 0.0;
    for (int i = 0; i < m->ny; ++i) sum[i] = of->factor[0]*k[0][i] + of->factor[of->count + 1]*k[RK4_STAGES][i];
    for (int j = 0; j < of->count; ++j) {
        m->method->interpolate(m, h, of->place[j], m->trial);
        if (ordernm_rates_of(m, m->t + of->place[j]*h, m->trial, rates, 0, 0, RATES)) return 0.0;
        for (int i = 0; i < m->ny; ++i) sum[i] += of->factor[j + 1]*rates[i];
    }
    for (int i = 0; i < m->ny; ++i) {
        const scalar error = h*fabs((k[0][i] + 2.0*(k[1][i] + k[2][i]) + k[3][i])/6.0 - sum[i])/(1.0 + fabs(m->z[i]));
        if (error > largest) largest = error, *entry = i;
    }
    return largest;
}

/* The classical method has no error estimate. Rates may change fast near poses of lost rank, and anywhere in models with steep functions.
 * Steps that may be too long are therefore compared with a quadrature of order 4 on the interpolant. The results contain the sum of the
 * differences, relative to the state. */
void ordernm_note_coarse(ordernm_motion *m, scalar h)
{
    ordernm_results *const r = m->results;
    scalar *const *const k = m->rate, apart = 0.0;
    const int steep = m->system->steep & 1;
    int entry = 0;
    if (m->problem->method != ORDERNM_RK4 || !(m->nd || steep)) return;
    for (int i = 0; i < m->ny; ++i) {
        const scalar middle = fabs(k[1][i] - k[2][i]), ends = steep ? fabs(k[0][i] - k[1][i] - k[2][i] + k[3][i]) : 0.0;
        apart = fmax(apart, fmax(middle, ends)/(1.0 + fabs(m->z[i])));
    }
    if (h*apart < LOOKED_AT) return;
    const scalar condition = r->condition, here = r->condition_here;
    const scalar error = difference(m, h, steep ? &in_halves : &simpson, &entry);
    r->coarse += error;
    if (error > r->coarsest) r->coarsest = error, r->coarse_at = m->t, r->coarse_entry = entry;
    r->condition = condition, r->condition_here = here;
}
