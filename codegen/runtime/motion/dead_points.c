/* Where independent coordinates do not determine the others: branches that meet where a loop loses rank, and dead points.
 *
 * At a dead point of the independent coordinates their speeds vanish while dependent ones go on, and say nothing of these; what is
 * small in them is large behind it. The closure's rank is lost there, so its condition is as 1/|t - dead point|, and the inverse of
 * the condition changes sign, which it does not show. A step that goes over such a point is smooth all the same, and its error
 * estimate tells nothing; so every step is looked at. */
#include "inside.h"

#include <math.h>
#include <string.h>

/* ---- Branches. ---- */

/* Tolerances by which dependent coordinates may differ from what a step predicts. */
static const scalar JUMP = 1e3;

/* Whether the dependent coordinates that loops have been closed with last are others than a step has led to: on another branch,
 * of those that meet where a loop loses rank. */
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

/* ---- At a dead point. ---- */

/* What may be left undetermined of dependent speeds, in parts of the largest, and by how much errors must have been made larger, for
 * loose tolerances alone say nothing of poses; and errors of independent speeds, in parts of 1 and of themselves, that there are
 * near such poses even where tolerances allow less, by rounding. */
static const scalar UNDETERMINED = 1e-4, ENLARGED = 1e3, BY_ROUNDING = 1e-8;

/* At a dead point of the independent coordinates their speeds vanish while dependent ones go on, and say nothing of these. Where a
 * loop itself loses rank dependent speeds follow the independent ones all the same. Which it is shows by how far dependents move if
 * independent speeds do; the map is linear. */
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

/* The place that stands for a dead point near which a step comes too near. */
static const scalar HALF = 0.5;

enum { PARTS = 8, LEVELS = RANKS_BETWEEN/(PARTS - 1) };

/* Two ends of an interval may have this many times what inverse conditions are seen to change by in it. */
static const scalar STEEPER = 2.0;

/* In parts of the step: places are not told apart that are nearer, where closed loops have a condition that rounding and the
 * interpolation limit. */
static const scalar FINE = 2e-3;

/* How far the two places are from lost rank, in parts of the way there, that tell by how much dependent speeds grow; and the least that
 * they grow by at a dead point, where it is the quotient of the distances. */
static const scalar FAR = 0.16, NEAR = 0.01, GROWN = 4.0;

/* The first interval from `from` on, of those between n times, in which a loop may lose rank, by how inverse conditions at the times change from
 * one to the next: smooth functions but for their sign. The number of intervals if there is none. */
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

/* The place in a step, from a to b, at which a loop loses rank; INFINITY if none does. */
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

/* The largest dependent speed that an independent one of 1 makes, at a place in the step; INFINITY where it cannot be had. */
static scalar growth(ordernm_motion *m, scalar h, scalar part)
{
    const ordernm_system *const s = m->system;
    scalar largest = 0.0;
    m->method->interpolate(m, h, part, m->trial);
    ordernm_call c;
    ordernm_arguments(m, m->t + part*h, m->trial, &c);
    if (ordernm_close_loops(m, &c)) return INFINITY;
    c.full_u = m->qdot; /* as long as it is needed, and not needed itself */
    for (int i = 0; i < s->nfree_u; ++i) m->u[s->free_u[i]] = 0.0;
    int i = 0;
    do { /* once where all that is independent is prescribed */
        if (i < s->nfree_u) m->u[s->free_u[i]] = 1.0;
        if (s->completion(&c)) return INFINITY;
        if (i < s->nfree_u) m->u[s->free_u[i]] = 0.0;
        for (int k = 0; k < s->nu; ++k) largest = fmax(largest, fabs(m->qdot[k]));
    } while (++i < s->nfree_u);
    return largest;
}

/* Inverse conditions in a step: the least and the largest that stages have, of the loop whose least is smallest, and where. */
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

/* Inverse conditions that change by more than this in a step: it is too long for a dead point that it comes near to. */
static const scalar LEAST_LEFT = 0.5;

/* Conditions from which on a dead point matters to steps of constant size, whose errors nobody sees; and from which on one does that
 * no step may come nearer to: of constant ones, and of others where the motion turns before it and may have been meant to pass. */
static const scalar COARSE = 10.0, TOO_NEAR = 100.0;

/* Of steps of constant size: what inverse condition and growth were where the condition has become larger than COARSE. */
static void note_calm(ordernm_motion *m, scalar h, const scalar *rank)
{
    scalar least = INFINITY;
    for (int i = 0; i < m->system->nloops; ++i) least = fmin(least, rank[i]);
    if (least*COARSE >= 1.0) m->calm_rank = 0.0;
    else if (m->calm_rank == 0.0) m->calm_rank = least, m->calm_growth = growth(m, h, 0.0);
}

/* Whether a step comes so near to a dead point that it says nothing of what is behind. Dependent speeds grow there as the condition
 * does; near a flattened linkage they do not. */
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

/* Where a loop itself loses rank, as in a flattened linkage, dependents follow all the same, and the motion passes; the coordinates
 * beside it say which derivatives do. */
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

/* Where in the step that was made, in parts of it, a dead point of the independent coordinates is; 0 if there is none. */
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
        if (i == method->stages - 1 && t == method->times[i + 1]) continue; /* both are at the end */
        int at = n++;
        for (; at > 0 && time[at - 1] > t; --at) time[at] = time[at - 1], rank[at] = rank[at - 1];
        time[at] = t, rank[at] = m->ranks + (long)i*nloops;
    }
    int other = 0; /* the same time as before: the later stage knows more */
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
    /* Nothing that is done here is part of the motion. */
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
