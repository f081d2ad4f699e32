/* Poses where independent coordinates do not determine the dependent ones: dead points, and poses of lost rank where two branches meet.
 *
 * At a dead point, the speeds of the independent coordinates vanish while dependent speeds do not. Small errors before a dead point become
 * large errors after it. The closure loses rank at a dead point: the condition number grows like 1/|t - dead point|, and its inverse
 * changes sign, although only the magnitude is computed. The motion of a step over a dead point is smooth, and the error estimate does not
 * show the point; so every step is tested. */
#include "inside.h"

#include <math.h>
#include <string.h>

/* ---- Branches. ---- */

/* Largest difference, in tolerances, between dependent coordinates and their predictions. */
static const scalar JUMP = 1e3;

/* Whether the loops were closed on another branch than predicted, where branches meet at a pose of lost rank. */
int ordernm_jumped(const ordernm_motion *m, const scalar *z)
{
    const ordernm_problem *p = m->problem;
    const scalar *predicted = z + m->ny + m->nx;
    for (int i = 0; i < m->nd; ++i) {
        const scalar q = m->q[m->dependent[i]];
        if (!(fabs(q - predicted[i]) <= JUMP*(p->atol[0] + p->rtol*(1.0 + fabs(q))) + 1e-9)) return 1;
    }
    return 0;
}

/* ---- Dead points. ---- */

/* Dependent speeds are undetermined if two of their changes, relative to the largest dependent speed, are too large: the change by errors
 * of the independent speeds exceeds UNDETERMINED, and the change per relative change of the independent speeds exceeds ENLARGED. Loose
 * tolerances alone do not indicate a pose. Errors of independent speeds are at least BY_ROUNDING, relative to 1 and to the speeds. */
static const scalar UNDETERMINED = 1e-4, ENLARGED = 1e3, BY_ROUNDING = 1e-8;

/* Whether the dependent speeds are undetermined at a dead point of the independent coordinates. If a loop itself loses rank, dependent
 * speeds still follow the independent ones. The linear map from independent to dependent speeds distinguishes the two cases. */
int ordernm_undetermined(ordernm_motion *m)
{
    const ordernm_problem *const p = m->problem;
    const ordernm_system *const s = m->system;
    scalar *const z = m->probe[0], *const here = m->probe[1], *const there = m->probe[2], *const error = m->probe[3],
        *const gain = m->probe[4];
    const long first = m->ny + m->nx;
    memcpy(z, m->z, m->values*sizeof(scalar));
    if (ordernm_rates_of(m, m->t, z, here, 0, 0, RATES | KNOWN_CLOSED)) return 0;
    scalar fastest = 0.0;
    for (int i = 0; i < m->nd; ++i) {
        error[i] = gain[i] = 0.0;
        if (fabs(here[first + i]) > fastest) fastest = fabs(here[first + i]);
    }
    for (int k = s->nfree_q; k < m->ny; ++k) {
        const scalar change = 1e-3*(1.0 + fabs(m->z[k])), size = 1.0 + fabs(m->z[k]);
        const scalar allowed = fmax(p->atol[k] + p->rtol*fabs(m->z[k]), BY_ROUNDING*size);
        z[k] = m->z[k] + change;
        if (ordernm_rates_of(m, m->t, z, there, 0, 0, RATES | KNOWN_CLOSED)) return 0;
        z[k] = m->z[k];
        for (int i = 0; i < m->nd; ++i) {
            const scalar moved = fabs(there[first + i] - here[first + i])/change;
            error[i] += moved*allowed;
            gain[i] += moved*size;
        }
    }
    for (int i = 0; i < m->nd; ++i)
        if (error[i] > UNDETERMINED*fastest && gain[i] > ENLARGED*fastest) return 1;
    return 0;
}

/* ---- Steps over dead points. ---- */

/* Position returned for a dead point that a step comes too close to. */
static const scalar HALF = 0.5;

enum { PARTS = 8, LEVELS = RANKS_BETWEEN/(PARTS - 1) };

/* A zero is possible in an interval if the values at its ends are smaller than this factor times the change expected in the interval. */
static const scalar STEEPER = 2.0;

/* Resolution of positions, relative to the step: near a pose, rounding and interpolation limit the condition number of closed loops. */
static const scalar FINE = 2e-3;

/* Distances from the pose where a loop loses rank, relative to the step, at which the growth of dependent speeds is compared. At a dead
 * point, the growth increases by at least GROWN from FAR to NEAR. */
static const scalar FAR = 0.16, NEAR = 0.01, GROWN = 4.0;

/* The first interval between two of n successive times, from number `from` on, in which a loop may lose rank. The changes of the inverse
 * condition numbers show this, because these numbers are smooth functions of time except for their sign. Returns the number of intervals if
 * there is none. */
static int suspicious(const ordernm_motion *m, int n, const scalar *t, const scalar *const *rank, int from)
{
    const int nloops = m->system->nloops;
    int first = n - 1;
    for (int loop = 0; loop < nloops; ++loop) {
        scalar steepest = 0.0;
        for (int k = 0; k + 1 < n; ++k) steepest = fmax(steepest, fabs(rank[k + 1][loop] - rank[k][loop])/(t[k + 1] - t[k]));
        for (int k = from; k < first; ++k)
            if (!(rank[k][loop] + rank[k + 1][loop] > STEEPER*steepest*(t[k + 1] - t[k]))) first = k;
    }
    return first;
}

/* Position in the step, from a to b, at which a loop loses rank; INFINITY if there is none. */
static scalar lost_between(ordernm_motion *m, scalar h, scalar a, scalar b, const scalar *at_a, const scalar *at_b, int level)
{
    const int nloops = m->system->nloops;
    scalar *const own = m->ranks_between + (long)level*(PARTS - 1)*nloops, t[PARTS + 1];
    const scalar *rank[PARTS + 1] = {at_a};
    if (level == LEVELS || b - a < FINE) return 0.5*(a + b);
    for (int j = 0; j <= PARTS; ++j) t[j] = a + (b - a)*j/(int)PARTS;
    rank[PARTS] = at_b;
    for (int j = 1; j < PARTS; ++j) {
        scalar *const here = own + (long)(j - 1)*nloops;
        m->method->interpolate(m, h, t[j], m->trial);
        ordernm_call c;
        ordernm_arguments(m, m->t + t[j]*h, m->trial, &c);
        if (ordernm_close_loops(m, &c)) return t[j];
        for (int i = 0; i < nloops; ++i) here[i] = 1.0/m->condition[i];
        rank[j] = here;
    }
    for (int k = 0; (k = suspicious(m, PARTS + 1, t, rank, k)) < PARTS; ++k) {
        const scalar found = lost_between(m, h, t[k], t[k + 1], rank[k], rank[k + 1], level + 1);
        if (found < INFINITY) return found;
    }
    return INFINITY;
}

/* The largest dependent speed per unit of an independent speed, at a position in the step; INFINITY if it cannot be computed. */
static scalar growth(ordernm_motion *m, scalar h, scalar part)
{
    const ordernm_system *const s = m->system;
    scalar largest = 0.0;
    m->method->interpolate(m, h, part, m->trial);
    ordernm_call c;
    ordernm_arguments(m, m->t + part*h, m->trial, &c);
    if (ordernm_close_loops(m, &c)) return INFINITY;
    c.full_u = m->qdot; /* qdot serves as scratch here */
    for (int i = 0; i < s->nfree_u; ++i) m->u[s->free_u[i]] = 0.0;
    int i = 0;
    do { /* the loop runs once if all independent coordinates are prescribed */
        if (i < s->nfree_u) m->u[s->free_u[i]] = 1.0;
        if (s->completion(&c)) return INFINITY;
        if (i < s->nfree_u) m->u[s->free_u[i]] = 0.0;
        for (int k = 0; k < s->nu; ++k) largest = fmax(largest, fabs(m->qdot[k]));
    } while (++i < s->nfree_u);
    return largest;
}

/* The extreme inverse condition numbers at the stages of a step, and their positions, for the loop with the smallest one. */
typedef struct {
    scalar least, largest, at_least, at_largest;
} spread;

static spread spread_of(const ordernm_motion *m, int n, const scalar *t, const scalar *const *rank)
{
    spread worst = {INFINITY, 0.0, 0.0, 0.0};
    for (int loop = 0; loop < m->system->nloops; ++loop) {
        spread found = {INFINITY, 0.0, 0.0, 0.0};
        for (int k = 0; k < n; ++k) {
            const scalar here = rank[k][loop];
            if (here < found.least) found.least = here, found.at_least = t[k];
            if (here > found.largest) found.largest = here, found.at_largest = t[k];
        }
        if (found.least < worst.least) worst = found;
    }
    return worst;
}

/* Smallest ratio of inverse condition numbers in a step near a dead point; below this ratio the step is too long. */
static const scalar LEAST_LEFT = 0.5;

/* Constant steps, whose errors are not estimated, are checked for dead points above the condition number COARSE. Near a dead point, their
 * condition number must not exceed TOO_NEAR. The same limit holds for adaptive steps if the motion turns before the dead point. */
static const scalar COARSE = 10.0, TOO_NEAR = 100.0;

/* For constant steps: stores inverse condition number and growth at the moment when the condition number exceeds COARSE. */
static void note_calm(ordernm_motion *m, scalar h, const scalar *rank)
{
    scalar least = INFINITY;
    for (int i = 0; i < m->system->nloops; ++i) least = fmin(least, rank[i]);
    if (least*COARSE >= 1.0) m->calm_rank = 0.0;
    else if (m->calm_rank == 0.0) m->calm_rank = least, m->calm_growth = growth(m, h, 0.0);
}

/* Whether a step comes too close to a dead point, where dependent speeds grow like the condition number. Near a flattened linkage,
 * dependent speeds do not grow. */
static int comes_too_near(ordernm_motion *m, scalar h, const spread *of)
{
    const int too_near = of->least*TOO_NEAR < 1.0;
    if (m->adaptive && !too_near) return 0;
    scalar rank = of->largest, far = 0.0;
    if (m->calm_rank > rank) rank = m->calm_rank, far = m->calm_growth;
    if (!(of->least < LEAST_LEFT*(too_near ? rank : of->largest))) return 0;
    if (far == 0.0) far = growth(m, h, of->at_largest);
    return !(growth(m, h, of->at_least) < far*sqrt(rank/of->least));
}

/* Whether the position is a dead point. If a loop itself loses rank, as in a flattened linkage, dependent speeds follow the independent
 * ones, and the motion passes the pose. Coordinates near the pose decide which derivatives exist. */
static int is_dead(ordernm_motion *m, scalar h, scalar part)
{
    const int nq = m->system->nq;
    const scalar way = part > 0.5 ? -part : 1.0 - part;
    const scalar far = growth(m, h, part + FAR*way);
    memcpy(m->flat + 1 + nq, m->q, nq*sizeof(scalar));
    const scalar near = growth(m, h, part + NEAR*way);
    memcpy(m->flat + 1, m->q, nq*sizeof(scalar));
    const int dead = !(near < GROWN*far);
    if (!dead && m->derived) m->flat[0] = m->t + part*h;
    return dead;
}

/* Position of a dead point of the independent coordinates in the step, relative to the step; 0 if there is none. */
scalar ordernm_dead_point_within(ordernm_motion *m, scalar h)
{
    m->flat[0] = -INFINITY;
    const scheme *const method = m->method;
    const int nloops = m->system->nloops;
    scalar time[MOST_STAGES];
    const scalar *rank[MOST_STAGES];
    int n = 0;
    for (int i = 0; i <= method->stages; ++i) {
        const scalar t = method->times[i];
        if (i == method->stages - 1 && t == method->times[i + 1]) continue; /* this stage and the next one are at the step's end */
        int at = n++;
        for (; at > 0 && time[at - 1] > t; --at) time[at] = time[at - 1], rank[at] = rank[at - 1];
        time[at] = t, rank[at] = m->ranks + (long)i*nloops;
    }
    int other = 0; /* of several stages at the same time, only the last one is kept */
    for (int i = 1; i < n; ++i) {
        if (time[i] > time[other]) ++other;
        time[other] = time[i], rank[other] = rank[i];
    }
    n = other + 1;
    int k = suspicious(m, n, time, rank, 0);
    const spread seen = spread_of(m, n, time, rank);
    const int coarse = !m->adaptive && seen.least*COARSE < 1.0;
    if (!coarse) m->calm_rank = 0.0;
    if (k >= n - 1 && !coarse) return 0.0;
    const int turns = k < n - 1;
    if (!m->complete) {
        if (method->complete(m, h)) return 0.0;
        m->complete = 1;
    }
    /* Trial states below do not belong to the motion: its limits and condition numbers are restored afterwards. */
    const scalar poor = m->poor, poor_rates = m->poor_rates, condition = m->results->condition, here = m->results->condition_here;
    scalar found = 0.0;
    m->poor = m->poor_rates = INFINITY;
    if (!m->adaptive) note_calm(m, h, rank[0]);
    for (; k < n - 1 && found == 0.0; k = suspicious(m, n, time, rank, k + 1)) {
        const scalar part = lost_between(m, h, time[k], time[k + 1], rank[k], rank[k + 1], 0);
        if (part < INFINITY && is_dead(m, h, part)) found = part;
    }
    if (found == 0.0 && (coarse || turns) && comes_too_near(m, h, &seen)) found = HALF;
    m->poor = poor, m->poor_rates = poor_rates;
    m->results->condition = condition, m->results->condition_here = here;
    return found;
}
