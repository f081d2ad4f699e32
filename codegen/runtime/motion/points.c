/* Points of a motion at which rates, or their derivatives, may be undefined: zeros of singular functions, such as the denominator of a
 * quotient, or x^2 + y^2 for atan2(y, x). Most such points are harmless: sin(x)/x is smooth. To find the others, rates and their
 * derivatives along directions are evaluated near the point, on both sides. */
#include "inside.h"

#include <math.h>
#include <string.h>

/* A singular function is evaluated at PARTS + 1 places of a step. If the function comes nearer to zero than a fraction of its largest value
 * in the step, its minimum is searched; a minimum below AT_POINT counts as zero. */
enum { PARTS = 4, GOLDEN = 48 };
static const scalar LEAST_PART = 1e-14, COARSE_PART = 1e-4; /* lengths of the interval at which a search, and a first look at the cubic, end */
static const scalar PART = 1.0/(int)PARTS, AT_END = 1e-9, NEAR = 0.2, NEAR_COARSE = 0.3, NEARER = 1e-3, AT_POINT = 1e-9;

/* Distance from a step, in step lengths, within which zeros matter. Outside of the step, a function counts as zero where it is below
 * AT_POINT_BESIDE times its value at the step's end. */
static const scalar BESIDE_STEP = 5.0, AT_POINT_BESIDE = 1e-12;

/* On each side, rates are evaluated at AWAY distances from the point, relative to the step, the farthest first. Rates have no limit at the
 * point if the changes between these distances do not decrease. Near the point, the limit follows by Aitken's rule, which is exact for a
 * power of the distance; farther away, by a parabola. Derivatives along a direction do not exist if the limits from near values and those
 * from values farther away both show a jump: rounding errors, as in (1 - cos(x))/x^2, disturb the former, and square roots the latter. */
enum { AWAY = 3, SIDES = 2*AWAY, SETS = ORDERNM_SIDES/SIDES };
static const scalar DISTANCE[SETS][AWAY] = {{1e-2, 1e-3, 1e-4}, {0.27, 0.09, 0.03}};
static const scalar CONVERGES = 0.8;

/* Accuracy of limits, relative to the change at the nearest distance. */
static const scalar BENT = 0.2;

/* Distance of a stage from the point, relative to the step, below which the stage counts as at the point. */
static const scalar HIT = 1e-12;

/* Rates are equal if their relative difference is below SAME, or if its effect on the integrated state is below ROUNDING. */
static const scalar SAME = 2e-5, ROUNDING = 1e-9;

/* Distances from the point, relative to DISTANCE. A rate counts as continuous if, at a tenth of the distance, its changes decrease at least
 * by the factor CONTINUOUS. */
static const scalar BESIDE_POINT[] = {-1.0, -0.4, 0.0, 0.7};
static const scalar CONTINUOUS = 0.3;

/* Values in the step, by the cubic through its ends. */
void ordernm_between(const ordernm_motion *m, scalar h, scalar x, scalar *z)
{
    const scalar y = 1.0 - x, *const first = m->rate[0], *const last = m->rate[m->method->stages];
    for (long i = 0; i < m->values; ++i)
        z[i] = y*y*((1.0 + 2.0*x)*m->z[i] + h*x*first[i]) + x*x*((3.0 - 2.0*x)*m->next[i] - h*y*last[i]);
}

/* All switching functions at a state, with the loops as predicted. */
static int look(ordernm_motion *m, scalar t, const scalar *z, scalar *found)
{
    ordernm_call c;
    ordernm_arguments(m, t, z, &c);
    c.switches = found;
    return m->system->switches(&c);
}

static scalar singular_function(ordernm_motion *m, scalar h, int k, scalar part, int exactly)
{
    const long size = m->size;
    m->size = m->values; /* switching functions need no derivatives of the state */
    if (exactly) m->method->interpolate(m, h, part, m->trial);
    else ordernm_between(m, h, part, m->trial);
    m->size = size;
    return look(m, m->t + part*h, m->trial, m->switches) ? NAN : m->switches[k];
}

/* The position, between two given ones, at which a singular function is zero or nearest to zero. A minimum is searched until the
 * interval is as short as `shortest`. */
static scalar nearest(ordernm_motion *m, scalar h, int k, scalar low, scalar high, int exactly, scalar shortest, scalar *least)
{
    static const scalar G = 0.61803398874989485;
    scalar first = singular_function(m, h, k, low, exactly), last = singular_function(m, h, k, high, exactly);
    if (first*last < 0.0) { /* Illinois method */
        for (int n = 0; n < GOLDEN && high - low > LEAST_PART; ++n) {
            const scalar secant = high - last*(high - low)/(last - first);
            const scalar middle = n%8 == 7 || !(secant > low && secant < high) ? 0.5*(low + high) : secant;
            const scalar here = singular_function(m, h, k, middle, exactly);
            if (here == 0.0) low = high = middle;
            else if (first*here > 0.0) low = middle, first = here, last *= 0.5;
            else high = middle, last = here, first *= 0.5;
        }
        *least = 0.0;
        return high;
    }
    scalar one = high - G*(high - low), other = low + G*(high - low);
    scalar f = fabs(singular_function(m, h, k, one, exactly)), g = fabs(singular_function(m, h, k, other, exactly));
    for (int n = 0; n < GOLDEN && high - low > shortest; ++n) {
        if (f < g) {
            high = other, other = one, g = f;
            f = fabs(singular_function(m, h, k, one = high - G*(high - low), exactly));
        } else {
            low = one, one = other, f = g;
            g = fabs(singular_function(m, h, k, other = low + G*(high - low), exactly));
        }
    }
    *least = fmin(f, g);
    return f < g ? one : other;
}

/* The smallest value of a parabola through three places between them, or the smallest of the three values. */
static scalar least_between(const scalar *y)
{
    const scalar slope = 0.5*(y[2] - y[0]), bend = y[2] - 2.0*y[1] + y[0], least = fmin(y[0], fmin(y[1], y[2]));
    return bend > 0.0 && fabs(slope) <= bend ? fmin(least, y[1] - 0.5*slope*slope/bend) : least;
}

/* Whether a singular function, with the values y at equal distances in the step, is zero there; `part` is the position. */
static int passes(ordernm_motion *m, scalar h, int k, const scalar *y, scalar *part)
{
    scalar size[PARTS + 1], range = 0.0, least;
    for (int i = 0; i <= PARTS; ++i) {
        if (y[i]*0.0 != 0.0) return 0;
        size[i] = fabs(y[i]), range = fmax(range, size[i]);
    }
    for (int i = 0; i <= PARTS; ++i) {
        const int from = i > 0 ? i - 1 : 0, to = i < PARTS ? i + 1 : PARTS, middle = i < 1 ? 1 : i < PARTS ? i : PARTS - 1;
        const int changes = y[from]*y[i] < 0.0 || y[i]*y[to] < 0.0;
        if (!changes && (size[i] > size[from] || size[i] > size[to] || !(range > 0.0))) continue;
        if (!changes && least_between(size + middle - 1) > NEAR*range) continue;
        const int falls = y[from]*y[i] < 0.0;
        const scalar low = PART*(falls || !changes ? from : i), high = PART*(falls ? i : to);
        nearest(m, h, k, low, high, 0, COARSE_PART, &least);
        if (!(least <= NEARER*range)) continue;
        if (!m->complete && m->method->complete(m, h)) return 0;
        m->complete = 1;
        *part = nearest(m, h, k, low, high, 1, 0.0, &least);
        if (least <= AT_POINT*range) return 1;
    }
    return 0;
}

/* Whether the values of a singular function at both ends and in the middle of the step permit a zero. */
static int may_pass(const ordernm_motion *m, int k)
{
    const int n = m->system->nswitches;
    const scalar *const y = m->singular + k;
    const scalar first = y[0], middle = y[PARTS/2*n], last = y[PARTS*n];
    const scalar size[] = {fabs(first), fabs(middle), fabs(last)};
    if (!(first*middle > 0.0 && middle*last > 0.0)) return 1;
    return !(least_between(size) > NEAR_COARSE*fmax(size[0], fmax(size[1], size[2])));
}

/* All singular functions at one of the places of a step. */
static int look_at(ordernm_motion *m, scalar h, int i)
{
    ordernm_between(m, h, PART*i, m->trial);
    return look(m, m->t + h*PART*i, m->trial, m->singular + i*m->system->nswitches);
}

/* Evaluates all singular functions at the start (known from the previous step), middle and end of a step; if one may be zero in the step,
 * at all places. Returns whether one may be zero. */
static int look_at_places(ordernm_motion *m, const trial *step)
{
    const ordernm_system *const s = m->system;
    int some = 0;
    if (m->singular_at == m->t && !m->switched) memcpy(m->singular, m->singular + PARTS*s->nswitches, s->nswitches*sizeof(scalar));
    else if (look_at(m, step->h, 0)) return 0;
    m->singular_at = NAN;
    if (look_at(m, step->h, PARTS/2) || look_at(m, step->h, PARTS)) return 0;
    if (step->end < step->knot) m->singular_at = step->end; /* inputs may jump at a knot */
    for (int k = 0; k < s->nswitches && !some; ++k) some = s->switch_kind[k] == ORDERNM_POINT && ordernm_matters(m, k) && may_pass(m, k);
    for (int i = 1; i < PARTS && some; i += 2)
        if (look_at(m, step->h, i)) return 0;
    return some;
}

/* Finds the next singular point in the step, for functions after `found->which`; returns whether there is one. */
int ordernm_next_point(ordernm_motion *m, const trial *step, point *found)
{
    const ordernm_system *const s = m->system;
    int cut = 0;
    if (found->which < 0 && !look_at_places(m, step)) return 0;
    for (int i = 0; i < m->nheld; ++i) cut |= step->event >= 0 && m->happened[m->problem->nevents + i] > 0.0;
    while (++found->which < s->nswitches) {
        const int k = found->which;
        scalar y[PARTS + 1];
        if (s->switch_kind[k] != ORDERNM_POINT || !ordernm_matters(m, k) || !may_pass(m, k)) continue;
        for (int i = 0; i <= PARTS; ++i) y[i] = m->singular[i*s->nswitches + k];
        if (!passes(m, step->h, k, y, &found->part)) continue;
        const int first = found->part < AT_END, last = found->part > 1.0 - AT_END;
        if (first && !m->switched && m->results->accepted) continue; /* the previous step has found this point */
        found->before = !(first && m->switched), found->after = !(last && cut);
        return 1;
    }
    return 0;
}

/* Whether a singular function is zero in the step or near it: at most BESIDE_STEP lengths away, by the cubic through its ends. There,
 * derivatives of rates may be unbounded, or lose their digits. */
int ordernm_near_point(ordernm_motion *m, const trial *step)
{
    const ordernm_system *const s = m->system;
    point at = {.which = -1};
    if (!m->npoints) return 0;
    if (ordernm_next_point(m, step, &at)) return 1;
    for (int k = 0; k < s->nswitches; ++k) {
        if (s->switch_kind[k] != ORDERNM_POINT || !ordernm_matters(m, k)) continue;
        for (int last = 0; last < 2; ++last) {
            const scalar here = fabs(singular_function(m, step->h, k, last, 0)), there = fabs(singular_function(m, step->h, k, 1 - last, 0));
            scalar least;
            if (here <= AT_POINT*there) return 1;
            nearest(m, step->h, k, last ? 1.0 : -BESIDE_STEP, last ? 1.0 + BESIDE_STEP : 0.0, 0, 0.0, &least);
            if (least <= AT_POINT_BESIDE*here) return 1;
        }
    }
    return 0;
}

/* Evaluates rates along all directions on both sides of the point. Returns the status of a function. */
int ordernm_look_at_point(ordernm_motion *m, scalar h, const point *at)
{
    m->method->interpolate(m, h, at->part, m->at_point);
    for (int n = 0; n < ORDERNM_SIDES; ++n) {
        const int behind = n%SIDES >= AWAY;
        const scalar part = at->part + (behind ? 1.0 : -1.0)*DISTANCE[n/SIDES][n%AWAY];
        if (!(behind ? at->after : at->before)) continue;
        m->method->interpolate(m, h, part, m->trial);
        const int status = ordernm_rates(m, m->t + part*h, m->trial, m->sides[n]);
        if (status) return status;
    }
    return 0;
}

/* The limit of a rate on one side of the point; `open` is the difference of the two nearest values if there is no limit. */
static scalar limit(scalar *const *sides, int set, long n, scalar *open)
{
    const scalar last = sides[2][n], before = sides[1][n] - sides[0][n], change = last - sides[1][n];
    *open = fabs(change) < CONVERGES*fabs(before) ? 0.0 : fabs(change);
    if (set) return (27.0*last - 12.0*sides[1][n] + sides[0][n])/16.0;
    return *open > 0.0 || change == 0.0 ? last : last - change*change/(change - before);
}

static scalar rate_at_point(const ordernm_motion *m, const point *at, int set, long n)
{
    scalar *const *const sides = m->sides + set*SIDES, open;
    const scalar one = at->before ? limit(sides, set, n, &open) : 0.0, other = at->after ? limit(sides + AWAY, set, n, &open) : 0.0;
    return at->before && at->after ? 0.5*(one + other) : one + other;
}

/* Whether a rate has no limit at the point, has different limits on its two sides, or has another value at a stage at the point. At the
 * point, formulas may give any value. Differences must exceed rounding errors and, for derivatives, the errors of steps. */
static int is_rough_in(const ordernm_motion *m, int set, scalar h, const point *at, long n, scalar allowed)
{
    scalar *const *const sides = m->sides + set*SIDES;
    const int both = at->before && at->after;
    scalar open[2] = {0.0, 0.0}, ends[2] = {0.0, 0.0};
    if (at->before) ends[0] = limit(sides, set, n, open);
    if (at->after) ends[1] = limit(sides + AWAY, set, n, open + 1);
    scalar jump = both ? fabs(ends[0] - ends[1]) : 0.0, size = fabs(m->rate[0][n]), bend = 0.0;
    for (int k = 0; k <= m->method->stages && both; ++k) {
        const scalar away = (k < m->method->stages ? m->method->times[k] : 1.0) - at->part;
        const scalar error = fabs(m->rate[k][n] - 0.5*(ends[0] + ends[1]));
        if (fabs(away) < HIT && !(error <= jump)) jump = error;
    }
    for (int k = 0; k < 2; ++k) {
        if (!(k ? at->after : at->before)) continue;
        size = fmax(size, fmax(fabs(sides[k*AWAY][n]), fabs(ends[k])));
        bend = fmax(bend, fabs(sides[k*AWAY + AWAY - 1][n] - ends[k]));
    }
    const scalar tends = set && both ? fmin(open[0], open[1]) : fmax(open[0], open[1]); /* farther away: a rate may have an extremum on one side */
    const scalar apart = fmax(jump <= BENT*bend ? 0.0 : jump, tends);
    return (ends[0] - ends[1])*0.0 != 0.0 || (!(apart <= SAME*size) && !(h*apart <= allowed));
}

/* Whether one of some rates is rough both near the point and farther away. The rates are `width` numbers apart in z. */
static int is_rough(const ordernm_motion *m, scalar h, const point *at, long first, int width)
{
    const long end = first + (m->ny + m->nx)*width;
    scalar integrated = 0.0;
    for (long n = first; n < end; n += width) integrated = fmax(integrated, fabs(m->z[n]));
    const scalar allowed = (first == 0 ? ROUNDING : fmax(ROUNDING, m->problem->rtol))*integrated;
    for (long n = first; n < end; n += width) {
        int rough = 1;
        for (int set = 0; set < SETS && rough; ++set) rough = is_rough_in(m, set, h, at, n, allowed);
        if (rough) return 1;
    }
    return 0;
}

int ordernm_rates_are_rough(const ordernm_motion *m, scalar h, const point *at) { return is_rough(m, h, at, 0, 1); }

/* The state at a point, shifted along the motion (by the cubic through the ends of the step) and along a direction; sets m->p, too. */
static void moved_state(ordernm_motion *m, scalar h, scalar part, const group *g, int lane, scalar by)
{
    ordernm_between(m, h, part, m->trial);
    for (long i = 0; i < m->ny + m->nx; ++i) m->trial[i] += by*m->at_point[g->at + i*g->width + lane];
    for (int i = 0; i < m->system->np; ++i) m->moved_p[i] = m->problem->p[i] + by*g->dp[i*g->width + lane];
}

static scalar moved_function(ordernm_motion *m, scalar h, const point *at, const group *g, int lane, scalar by)
{
    moved_state(m, h, at->part, g, lane, by);
    m->p = m->moved_p;
    const int status = look(m, m->t + at->part*h, m->trial, m->switches);
    m->p = m->problem->p;
    return status ? 0.0 : fabs(m->switches[at->which]);
}

/* Shift along a direction that changes the singular function from zero to its value at the farthest distance along the motion; 0 if the
 * function is zero along the whole direction. */
static scalar reach(ordernm_motion *m, scalar h, const point *at, scalar farthest, const group *g, int lane)
{
    scalar size = 0.0, by, here;
    const scalar away = fabs(singular_function(m, h, at->which, at->part + (at->part < 0.5 ? 1.0 : -1.0)*farthest, 1));
    for (long i = 0; i < m->ny + m->nx; ++i) size = fmax(size, fabs(m->at_point[g->at + i*g->width + lane]));
    for (int i = 0; i < m->system->np; ++i) size = fmax(size, fabs(g->dp[i*g->width + lane]));
    if (!(size > 0.0)) return 0.0;
    by = 1.0/size;
    for (int n = 0; n < 20 && (here = moved_function(m, h, at, g, lane, by)) <= away; ++n) by *= 4.0;
    if (here <= away) return 0.0;
    for (int n = 0; n < 80 && here > away; ++n) { /* the function decreases with the shift or its square */
        by *= fmin(0.5, sqrt(away/here));
        here = moved_function(m, h, at, g, lane, by);
    }
    return by;
}

/* Whether rates change from the point to places near it, along a direction, by an amount that does not decrease with the distance. */
static int jumps_beside(ordernm_motion *m, int set, scalar h, const point *at, const group *g, int lane)
{
    const scalar farthest = DISTANCE[set][0];
    const int n = m->ny + m->nx;
    scalar *const change = m->error[0], *const nearer = m->error[1], *const rates = m->at_pose;
    scalar largest = 0.0, worst = 0.0;
    const scalar by = reach(m, h, at, farthest, g, lane);
    if (!(by > 0.0)) return 0;
    m->p = m->moved_p;
    memset(change, 0, m->values*sizeof(scalar));
    memset(nearer, 0, m->values*sizeof(scalar));
    for (int near = 0; near < 2; ++near)
        for (int i = 0; i < 8; ++i) {
            const scalar scale = near ? 0.1 : 1.0, along = at->part + scale*farthest*BESIDE_POINT[i/2];
            moved_state(m, h, along, g, lane, (i%2 ? scale : -scale)*by);
            const int status = ordernm_rates_of(m, m->t + along*h, m->trial, rates, 0, 0, RATES | INTEGRALS);
            for (int k = 0; k < n && !status; ++k) {
                const scalar d = fabs(rates[k] - rate_at_point(m, at, set, k));
                scalar *const most = (near ? nearer : change) + k;
                if (!(d <= *most)) *most = d;
            }
        }
    m->p = m->problem->p;
    for (int k = 0; k < n; ++k) largest = fmax(largest, fmax(fabs(rate_at_point(m, at, set, k)), change[k]));
    for (int k = 0; k < n; ++k)
        if (!(nearer[k] <= CONTINUOUS*change[k])) worst = nearer[k] == nearer[k] ? fmax(worst, nearer[k]) : INFINITY;
    return worst > SAME*largest;
}

/* Whether a direction has no derivative after a singular point. */
int ordernm_lost_at_point(ordernm_motion *m, scalar h, const point *at, int n, int lane)
{
    const group *const g = m->groups + n;
    if (is_rough(m, h, at, g->at + lane, g->width)) return 1;
    for (int k = 0; k < SETS; ++k)
        if (!at->before || !at->after || !jumps_beside(m, k, h, at, g, lane)) return 0;
    return 1;
}
