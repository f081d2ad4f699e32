/* Switches: where forces or outputs change their branch.
 *
 * Within a step every switch keeps its mode, the sign of its switching function, so that a step sees one smooth extension of the
 * rates. A step that a switching function changes its sign in is made again so that it ends there; then the mode changes. The state
 * is continuous there, and its derivatives along directions jump,
 *
 *     S+ = S- + (f- - f+) dt,  dt = -(g_z S- + g_p)/g',  g' = g_z f- + g_t,
 *
 * with f- and f+ the rates before and after. Backwards, with the adjoint lambda+ behind it,
 *
 *     w = -(lambda+ . (f- - f+) + J_t)/g',  lambda- = lambda+ + w g_z,  gradient += w g_p,
 *
 * where J_t is how a functional depends on the time of the switch, as one of an event does whose output jumps there.
 */
#include "backwards.h"

#include <math.h>
#include <string.h>

/* A switching function that changes at less than this part of its pace in the step touches zero only. */
static const double GRAZING = 1e-9;

/* Rates that differ by less, relative to their size, do not jump. */
static const double SAME = 1e-13;

/* As near to zero at the beginning, in the time of the motion, a switching function is taken as zero. */
static const double AT_ZERO = 1e-13;

/* In parts of the motion's time: switches that are passed within the first accumulate, one that is passed twice within the other has
 * rounding only to thank for it. */
static const double ACCUMULATED = 1e-8, AT_ONCE = 1e-12;

enum { FEW_REFUSED = 3 };

static const double TURN_OF_A_STEP = 2.0; /* rad */

static double sign_of(double x) { return (x > 0.0) - (x < 0.0); }

static const double HALF_A_TURN = 3.14159265358979323846;

/* How far a switch is from where its mode changes, positive on the side of the mode. */
double ordernm_side(const ordernm_motion *m, int k)
{
    const double x = m->switches[k];
    if (m->modes[k] == 0.0) return LEAST_SIDE; /* it is let go */
    return m->system->switch_kind[k] == ORDERNM_TURN ? HALF_A_TURN*HALF_A_TURN - x*x : m->modes[k]*x;
}

/* The mode behind the place where a switch changes it, or where it is by the state when it is beyond. */
static double other_mode(const ordernm_motion *m, int k)
{
    if (m->system->switch_kind[k] == ORDERNM_TURN) return m->switches[k] > 0.0 ? -HALF_A_TURN : HALF_A_TURN;
    return -m->modes[k];
}

/* The mode by the state, from the switching function without a mode. */
static double mode_of(const ordernm_motion *m, int k)
{
    const double x = m->switches[k];
    if (m->system->switch_kind[k] == ORDERNM_TURN) return x != 0.0 ? x : LEAST_SIDE;
    return sign_of(x);
}

/* The modes of switches that the rates of this motion depend on are held, and of those in outputs that events are of. */
void ordernm_hold_switches(ordernm_motion *m)
{
    const ordernm_system *const s = m->system;
    const ordernm_problem *const p = m->problem;
    m->nheld = 0;
    if (!s->switches) return;
    for (int k = 0; k < s->nswitches; ++k) {
        int held = s->drives[k];
        for (int i = 0; i < s->nswitch_outputs && !held; ++i) {
            if (s->switch_of_output[2*i] != k) continue;
            const int output = s->switch_of_output[2*i + 1];
            for (int n = 0; n < m->nx; ++n) held |= p->integrals[n] == output;
            for (int n = 0; n < p->nevents; ++n) held |= p->events[n].output == output;
        }
        if (held) m->held[m->nheld++] = k;
    }
}

/* All switching functions at a state, in the modes at hand. Returns what a function returned. */
int ordernm_switching(ordernm_motion *m, double t, const double *z)
{
    ordernm_call c;
    ordernm_arguments(m, t, z, &c);
    int status = ordernm_close_loops(m, &c);
    if (status) ordernm_arguments(m, t, z, &c); /* where a loop has lost rank, as the step has predicted */
    c.switches = m->switches;
    return ORDERNM_VALUES_OF(m, switches)(&c);
}

/* How fast a switching function changes along rates. Returns what a function returned. */
static int slope(ordernm_motion *m, double t, const double *z, const double *rate, int k, double *found)
{
    ordernm_call c;
    int status = ordernm_along_time(m, t, z, rate, &c);
    if (status) return status;
    c.switches = m->switches, c.dswitches = m->dswitches;
    status = ORDERNM_OF(m, switch_sensitivities[ORDERNM_ONE])(&c);
    *found = m->dswitches[k];
    return status;
}

/* The derivatives of a switching function along all directions at a fixed time, LANES numbers for each group. */
static int along_directions(ordernm_motion *m, double t, const double *z, int k)
{
    ordernm_call c;
    ordernm_arguments(m, t, z, &c);
    int status = ordernm_close_loops(m, &c);
    for (int n = 0; n < m->ngroups && !status; ++n) {
        const group *const g = m->groups + n;
        ordernm_seeds(m, t, z, g, &c);
        c.switches = m->switches, c.dswitches = m->dswitches;
        status = ORDERNM_OF(m, switch_sensitivities[g->index])(&c);
        memcpy(m->switch_along + n*LANES, m->dswitches + (long)k*g->width, g->width*sizeof(double));
    }
    return status;
}

/* Gives switches other than `but` the modes that their functions have. Those of which nobody knows the side stay. */
static int follow(ordernm_motion *m, double t, const double *z, const double *crossed)
{
    const int status = ordernm_switching(m, t, z);
    for (int i = 0; i < m->nheld && !status; ++i) {
        const int k = m->held[i];
        if (crossed && crossed[k] != 0.0) continue;
        if (ordernm_side(m, k) < 0.0) m->modes[k] = other_mode(m, k);
    }
    return status;
}

static int jumps(const ordernm_motion *m, const double *before, const double *after)
{
    for (int i = 0; i < m->ny + m->nx; ++i)
        if (fabs(before[i] - after[i]) > SAME*(fabs(before[i]) + fabs(after[i]))) return 1;
    return 0;
}

/* How far switching functions are from zero at the beginning of a step, on the side of their modes. */
int ordernm_sides(ordernm_motion *m, double t, const double *z, double *sides)
{
    const int status = ordernm_switching(m, t, z);
    for (int i = 0; i < m->nheld; ++i) {
        const double side = ordernm_side(m, m->held[i]);
        sides[i] = side > LEAST_SIDE ? side : LEAST_SIDE;
    }
    return status;
}

/* The modes at the beginning. Where a switching function is zero there, it is asked where it goes to with either mode. Returns 0, what
 * a function returned, or SLIDES with the switch in the results. */
int ordernm_choose_modes(ordernm_motion *m, double t, const double *z)
{
    const double reach = AT_ZERO*(m->problem->end - m->problem->start);
    double *const rate = m->trial;
    int status;
    for (int k = 0; k < m->system->nswitches; ++k) m->modes[k] = 0.0, m->changed[k] = -INFINITY;
    if ((status = ordernm_switching(m, t, z))) return status;
    for (int i = 0; i < m->nheld; ++i) m->crossed[m->held[i]] = m->switches[m->held[i]];
    for (int i = 0; i < m->nheld; ++i) {
        const int k = m->held[i];
        const double g = m->crossed[k];
        if (m->system->switch_kind[k] != ORDERNM_SIGN) {
            m->switches[k] = g;
            m->modes[k] = mode_of(m, k);
            continue;
        }
        const int side = g > 0.0 ? 1 : -1; /* with the other branch of prescribed motion loops may not close */
        double way[3]; /* with the mode -1, 0, 1 */
        for (int n = 0; n < 3; ++n) {
            const int mode = n == 0 ? side : n == 1 ? 0 : -side;
            m->modes[k] = mode;
            if ((status = ordernm_rates_of(m, t, z, rate, 0, 0, RATES))) return status;
            if ((status = slope(m, t, z, rate, k, way + 1 + mode))) return status;
            if (n == 0 && fabs(g) > reach*fabs(way[1 + side])) break; /* it is not zero */
        }
        if (fabs(g) > reach*fabs(way[1 + side])) m->modes[k] = side;
        else if (way[2] >= 0.0 && way[0] >= 0.0 && way[2] + way[0] > 0.0) m->modes[k] = 1.0;
        else if (way[2] <= 0.0 && way[0] <= 0.0 && way[2] + way[0] < 0.0) m->modes[k] = -1.0;
        else if (way[1] == 0.0) m->modes[k] = 0.0; /* it rests there */
        else if (way[2] < 0.0) {
            m->results->component = k;
            return SLIDES;
        } else m->modes[k] = 1.0;
    }
    memset(m->crossed, 0, m->system->nswitches*sizeof(double));
    return 0;
}

/* A switching function comes to zero and turns, at the state in m->trial: derivatives do not exist where rates jump there. */
void ordernm_touch(ordernm_motion *m, double t, int k)
{
    const double mode = m->modes[k];
    double *const one = m->error[0], *const other = m->error[1];
    if (ordernm_rates_of(m, t, m->trial, one, 0, 0, RATES | INTEGRALS)) return;
    m->modes[k] = -mode;
    const int status = ordernm_rates_of(m, t, m->trial, other, 0, 0, RATES | INTEGRALS);
    m->modes[k] = mode;
    if (!status && jumps(m, one, other)) m->results->grazed = k + 1;
}

/* Counts switches with a jump that are passed, again and again in a time that is nothing beside the motion's. Kinks do not accumulate
 * by themselves: a motion that passes many of them in no time has a cause elsewhere, such as speeds that grow beyond all bounds. */
static void count(ordernm_motion *m, int k)
{
    if (m->passed == 0 || m->t - m->accumulating > ACCUMULATED*(m->problem->end - m->problem->start)) {
        m->accumulating = m->t;
        m->passed = 0;
    }
    ++m->passed;
    m->last_passed = k;
}

/* ---- Passing switches. ---- */

/* Changes the mode of a switch whose function is zero at a state z. `before` holds the rates in front of it, `after` becomes those
 * behind it, and derivatives along directions in z become those behind it. With `follows`, switches other than those in m->crossed take
 * the modes of their functions. Returns what a function returned. */
static int pass(ordernm_motion *m, double *z, int k, const double *before, double *after, int follows, double *speed)
{
    const long n = m->ny + m->nx;
    int status = slope(m, m->t, z, before, k, speed);
    if (!status && m->ngroups) status = along_directions(m, m->t, z, k);
    if (status) return status;
    m->modes[k] = other_mode(m, k);
    if (follows && (status = follow(m, m->t, m->z, m->crossed))) return status;
    if ((status = ordernm_rates_of(m, m->t, z, after, 0, 0, RATES | INTEGRALS))) return status;
    for (int i = 0; i < m->ngroups*LANES; ++i) m->passing_time[i] = -m->switch_along[i]/ *speed;
    if (!jumps(m, before, after) || !(fabs(*speed) > GRAZING*m->crossed[k])) return 0;
    for (int g = 0; g < m->ngroups; ++g) {
        const group *const of = m->groups + g;
        double *const S = z + of->at;
        for (int i = 0; i < n; ++i)
            for (int l = 0; l < of->width; ++l)
                S[i*of->width + l] += (before[i] - after[i])*m->passing_time[g*LANES + l];
    }
    return 0;
}

/* A switch is about to be passed: it joins those that have been passed at the same time, or begins a new row of these. */
static void gather(ordernm_motion *m, int k)
{
    int joins = m->ntogether && m->t - m->together_since <= AT_THE_SAME_TIME*(m->problem->end - m->problem->start);
    for (int i = 0; i < m->ntogether; ++i) joins &= m->together[i] != k;
    if (!joins) {
        m->ntogether = m->together_jump = 0;
        m->together_since = m->t;
        memcpy(m->z_before, m->z, m->size*sizeof(double));
        memcpy(m->modes_before, m->modes, m->system->nswitches*sizeof(double));
    }
    m->together[m->ntogether++] = k;
}

/* Whether derivatives along a direction, entry `at` of states, differ between two orders of switches, beside how they jump. */
static int differ(const ordernm_motion *m, const group *of, int lane, const double *other)
{
    for (long i = 0; i < m->ny + m->nx; ++i) {
        const long at = of->at + i*of->width + lane;
        const double here = m->z[at], there = other[at], first = m->z_before[at];
        const double allowed = ORDER_MATTERS*(fabs(here - first) + fabs(there - first)) + 1e-10*(fabs(here) + fabs(first));
        if (!(fabs(here - there) <= allowed)) return 1;
    }
    return 0;
}

/* Several switches have been passed at one time. A disturbed motion passes them one after another, in an order that depends on the
 * disturbance. Along a direction for which the order matters there is no derivative. Three switches are passed in every order, more in
 * all rotations of two orders. Returns what a function returned. */
static int compare_orders(ordernm_motion *m)
{
    const int n = m->ntogether, count = m->system->nswitches;
    double *const z = m->error[0], *const rates = m->rate[1];
    double *const kept = m->switches_kept;
    int status = 0;
    memcpy(kept, m->modes, count*sizeof(double));
    for (int order = 1; order < 2*n && !status; ++order) {
        double speed;
        memcpy(z, m->z, m->values*sizeof(double));
        memcpy(z + m->values, m->z_before + m->values, (m->size - m->values)*sizeof(double));
        for (int i = 0; i < n; ++i) m->modes[m->together[i]] = m->modes_before[m->together[i]];
        status = ordernm_rates_of(m, m->t, z, rates, 0, 0, RATES | INTEGRALS);
        for (int i = 0; i < n && !status; ++i) {
            const int at = (order < n ? i : n - 1 - i) + order;
            memcpy(m->trial, rates, m->values*sizeof(double));
            status = pass(m, z, m->together[at%n], m->trial, rates, 0, &speed);
        }
        for (int g = 0; g < m->ngroups && !status; ++g)
            for (int l = 0; l < m->groups[g].used; ++l)
                if (differ(m, m->groups + g, l, z)) m->lost[g*LANES + l] = m->switch_time[g*LANES + l] = NAN;
    }
    memcpy(m->modes, kept, count*sizeof(double));
    for (int i = 0; i < m->ngroups*LANES; ++i)
        if (m->lost[i] != 0.0) m->results->ordered = 1;
    return status;
}

/* Whether a switch is in an output that an event is of. */
static int times_event(const ordernm_motion *m, int k)
{
    const ordernm_system *const s = m->system;
    const ordernm_problem *const p = m->problem;
    for (int i = 0; i < s->nswitch_outputs; ++i)
        for (int e = 0; s->switch_of_output[2*i] == k && e < p->nevents; ++e)
            if (p->events[e].output == s->switch_of_output[2*i + 1]) return 1;
    return 0;
}

/* Derivatives of the time of a passing, for events of outputs that jump there: NaN where two switches of such outputs disagree. */
static void note_time(ordernm_motion *m, int k, int *timed)
{
    if (!times_event(m, k)) return;
    for (int i = 0; i < m->ngroups*LANES; ++i) {
        const double here = m->passing_time[i], first = m->switch_time[i];
        m->switch_time[i] = !*timed || fabs(here - first) <= ORDER_MATTERS*(fabs(here) + fabs(first)) ? here : NAN;
    }
    *timed = 1;
}

/* The passed switches must not be pushed back to by the rates behind all of them. */
static int slides(ordernm_motion *m, const double *after)
{
    for (int k = 0; k < m->system->nswitches; ++k) {
        double way;
        if (m->speeds[k] == 0.0) continue;
        const int status = slope(m, m->t, m->z, after, k, &way);
        if (status) return status;
        if (m->speeds[k]*way > 0.0) continue;
        m->results->component = k;
        return SLIDES;
    }
    return 0;
}

/* At the end of a step, where switching functions of the switches in m->crossed are zero and the rates in rate[0] are those before:
 * modes, and derivatives along directions, become those behind. Returns 0, what a function returned, or SLIDES. */
int ordernm_pass_switches(ordernm_motion *m)
{
    const ordernm_system *const s = m->system;
    double *const before = m->trial, *const after = m->rate[0];
    int left = 0, status, timed = 0;
    for (int k = 0; k < s->nswitches; ++k) left += m->crossed[k] != 0.0;
    memset(m->speeds, 0, s->nswitches*sizeof(double));
    for (int k = 0; k < s->nswitches; ++k) {
        if (m->crossed[k] == 0.0) continue;
        double speed;
        const int at_once = m->t - m->changed[k] <= AT_ONCE*(m->problem->end - m->problem->start);
        gather(m, k);
        m->changed[k] = m->t;
        memcpy(before, m->rate[0], (m->ny + m->nx)*sizeof(double));
        if ((status = pass(m, m->z, k, before, after, --left == 0, &speed))) return status;
        note_time(m, k, &timed);
        if (!jumps(m, before, after)) {
            if (at_once) m->modes[k] = 0.0; /* rounding goes to and fro across a kink */
            continue;
        }
        count(m, k);
        m->speeds[k] = speed != 0.0 ? speed : LEAST_SIDE;
        m->together_jump = 1;
        if ((m->ngroups || m->results->steps) && !(fabs(speed) > GRAZING*m->crossed[k])) m->results->grazed = k + 1;
    }
    if ((status = slides(m, after))) return status;
    if (m->ntogether < 2 || !(m->together_jump || timed)) return 0;
    m->results->together = 1 + m->together[m->ntogether - 1];
    m->results->together_with = 1 + m->together[m->ntogether - 2];
    m->results->together_at = m->t;
    return m->ngroups ? compare_orders(m) : 0;
}

/* Whether switches have been passed faster and faster. */
int ordernm_accumulates(const ordernm_motion *m)
{
    if (m->passed < 3 || m->t - m->accumulating > ACCUMULATED*(m->problem->end - m->problem->start)) return 0;
    m->results->component = m->last_passed;
    return 1;
}

/* Rates that are held may have no value beyond a switch, such as a root of what is negative there. Such a step is made in whichever
 * branches its states are in, once smaller steps have not helped. Returns whether modes have been let go. */
int ordernm_let_go(ordernm_motion *m)
{
    int held = 0;
    if (++m->not_held < FEW_REFUSED) return 0;
    for (int i = 0; i < m->nheld; ++i) held |= m->modes[m->held[i]] != 0.0;
    for (int i = 0; i < m->nheld; ++i) {
        const int k = m->held[i];
        if (m->modes[k] != 0.0) m->let_go[k] = m->modes[k];
        m->modes[k] = 0.0;
    }
    m->not_held = 0;
    return held && !ordernm_rates(m, m->t, m->z, m->rate[0]);
}

/* What was let go for a step is held again. Returns what a function returned. */
int ordernm_hold_again(ordernm_motion *m)
{
    int status = 0, any = 0;
    const int *const kind = m->system->switch_kind;
    for (int i = 0; i < m->nheld; ++i) {
        const int k = m->held[i];
        any |= m->changed[k] < m->t && (m->modes[k] == 0.0 || kind[k] == ORDERNM_TURN);
    }
    if (!any || (status = ordernm_switching(m, m->t, m->z))) return status;
    for (int i = 0; i < m->nheld; ++i) {
        const int k = m->held[i];
        if (!(m->changed[k] < m->t)) continue;
        const int free = m->modes[k] == 0.0;
        if (free || kind[k] == ORDERNM_TURN) m->modes[k] = mode_of(m, k); /* angles are those near where the step begins */
        m->switched |= free && m->modes[k] != 0.0;
        if (kind[k] == ORDERNM_SIGN && m->let_go[k]*m->modes[k] < 0.0) m->results->not_held = k + 1;
        m->let_go[k] = 0.0;
    }
    return 0;
}

/* How long a step may be, by how fast angles turn that jump at half a turn. Returns what a function returned. */
int ordernm_limit_turns(ordernm_motion *m)
{
    m->turning = 0.0;
    for (int i = 0; i < m->nheld; ++i) {
        if (m->system->switch_kind[m->held[i]] != ORDERNM_TURN) continue;
        double speed;
        const int status = slope(m, m->t, m->z, m->rate[0], m->held[i], &speed);
        if (status) return status;
        const double longest = TURN_OF_A_STEP/fabs(speed);
        if (longest < INFINITY && (m->turning == 0.0 || longest < m->turning)) m->turning = longest;
    }
    return 0;
}

/* At a knot of the inputs switching functions may jump; its time depends on nothing. */
int ordernm_follow_inputs(ordernm_motion *m)
{
    return follow(m, m->t, m->z, 0);
}

/* ---- Backwards. ---- */

/* Modes as they are kept with a step, and whether the switch has just been crossed. */
void ordernm_keep_modes(const ordernm_motion *m, double *row)
{
    const int n = m->system->nswitches;
    for (int k = 0; k < n; ++k) row[k] = m->modes[k], row[n + k] = m->crossed[k] != 0.0;
}

/* Modes from such a row. */
void ordernm_take_modes(ordernm_motion *m, const double *row)
{
    const int n = m->system->nswitches;
    for (int k = 0; k < n; ++k) m->modes[k] = row[k], m->crossed[k] = row[n + k];
}

/* The adjoint before the switches that are crossed where the next step begins, whose modes are those of a row; the modes at hand are
 * those before. Functionals may depend on the time of the last one. */
int ordernm_switches_transposed(ordernm_adjoint *a, double t, const double *z, const double *row)
{
    ordernm_motion *const m = a->motion;
    const int count = m->system->nswitches, n = m->ny + m->nx;
    const double *const crossed = row + count;
    int last = -1, status = 0;
    for (int k = 0; k < count; ++k)
        if (crossed[k] != 0.0) last = k;
    if (last < 0) return 0;
    double *const first = m->crossed;
    memcpy(first, m->modes, count*sizeof(double));
    for (int k = last; k >= 0 && !status; --k) {
        if (crossed[k] == 0.0) continue;
        double *const after = m->next, *const before = m->trial, speed;
        for (int i = 0; i < count; ++i) m->modes[i] = k == last || (i <= k && crossed[i] != 0.0) ? row[i] : first[i];
        if ((status = ordernm_rates_of(m, t, z, after, 0, 0, RATES | INTEGRALS))) break;
        for (int i = 0; i < count; ++i) m->modes[i] = i < k && crossed[i] != 0.0 ? row[i] : first[i];
        if ((status = ordernm_rates_of(m, t, z, before, 0, 0, RATES | INTEGRALS))) break;
        const int timed = k == last && a->timed >= 0;
        if (!jumps(m, before, after) && !timed) continue;
        if ((status = slope(m, t, z, before, k, &speed))) break;
        for (int i = 0; i < n; ++i) before[i] -= after[i];
        for (int g = 0; g < a->ngroups && !status; ++g) status = ordernm_switch_transposed(a, g, t, z, k, before, speed, timed);
    }
    a->timed = -1;
    memcpy(m->modes, first, count*sizeof(double));
    memset(m->crossed, 0, count*sizeof(double));
    return status;
}
