/* Poses where a loop loses rank, such as a flat parallelogram: a motion passes them between the stages of a step.
 *
 * Near such a pose, the condition number of the closure grows like 1/|t - pose|, and rounding errors of accelerations with its square or
 * cube. The stages of a step can keep away from the pose: the condition numbers at the stages of a tried step give the time of the pose,
 * and the step is repeated so that the pose is in the widest gap between stages. */
#include "inside.h"

#include <math.h>
#include <string.h>

/* Relative deviation from a straight line below which inverse condition numbers indicate a pose; constantly large condition numbers do not. */
static const scalar STRAIGHT = 0.03;

/* Smallest distance of a stage, or of the step's end, from a pose, relative to the step. In the widest gap of DOP853, 0.13 is possible. The
 * end counts because the next step starts there: the nearer to the pose, the smaller must this step be. */
static const scalar NEAR = 0.1;

/* Fits a straight line through n points, and computes its zero. Returns the sum of squares of the residuals, relative to that of the
 * deviations of the values from their mean. */
static scalar zero_of_line(const scalar *t, const scalar *s, int n, scalar *zero)
{
    scalar mean_t = 0.0, mean_s = 0.0, tt = 0.0, ts = 0.0, ss = 0.0;
    for (int i = 0; i < n; ++i) mean_t += t[i]/n, mean_s += s[i]/n;
    for (int i = 0; i < n; ++i) {
        tt += (t[i] - mean_t)*(t[i] - mean_t);
        ts += (t[i] - mean_t)*(s[i] - mean_s);
        ss += (s[i] - mean_s)*(s[i] - mean_s);
    }
    if (!(tt > 0.0) || ts == 0.0) return INFINITY;
    *zero = mean_t - mean_s*tt/ts;
    return (ss - ts*ts/tt)/ss;
}

/* If a stage of the tried step has a large condition number: estimates the time of the pose that causes it. There, the inverse of the
 * condition number changes sign, but only its magnitude is known. So a sign change is tried on each side of the worst stage; the
 * straighter line wins. Returns whether a stage is too near to the pose. */
int ordernm_find_pose(ordernm_motion *m, scalar h)
{
    const int end = m->method->stages;
    scalar time[MOST_STAGES], inverse[MOST_STAGES];
    int n = 0;
    for (int i = 0; i <= end; ++i) {
        const scalar t = m->method->times[i]*h;
        const int at_end = i == end - 1 && m->method->times[i] == m->method->times[end]; /* an explicit method's last stage */
        if (!(m->conditions[i] > 0.0) || (at_end && m->conditions[end] > 0.0)) continue;
        int at = n++;
        for (; at > 0 && time[at - 1] > t; --at) time[at] = time[at - 1], inverse[at] = inverse[at - 1];
        time[at] = t;
        inverse[at] = 1.0/m->conditions[i];
    }
    int worst = 0;
    for (int i = 1; i < n; ++i)
        if (!(inverse[i] >= inverse[worst])) worst = i;
    const int too_poor = n > 2 && inverse[worst]*m->too_poor <= 1.0;
    if (n < 3 || !(too_poor || (m->adaptive && !m->method->gives_rate && inverse[worst]*m->telling <= 1.0))) return 0;
    const int first = worst > 2 ? worst - 2 : 0, last = worst + 2 < n ? worst + 2 : n - 1;
    scalar straightest = STRAIGHT, found = -INFINITY;
    for (int sign = worst; sign <= worst + 1; ++sign) { /* after the pose, the inverse is positive */
        scalar s[5], zero = -INFINITY;
        for (int i = first; i <= last; ++i) s[i - first] = i < sign ? -inverse[i] : inverse[i];
        const scalar left = zero_of_line(time + first, s, last - first + 1, &zero);
        if (left < straightest) straightest = left, found = zero;
    }
    if (!(found > -INFINITY)) return 0;
    m->pose = m->t + found;
    return too_poor || fabs(time[worst] - found) < NEAR*h;
}

/* Largest error that rounding of constants to double precision causes, per condition number^3. An error that the step size causes decreases
 * at least by the factor LESS if the step decreases by the factor SMALLER. */
static const scalar BY_CONSTANTS = 128*2.2e-16, SMALLER = 0.9, LESS = 0.5;

/* Whether rounding explains the error of a step across a pose: the error did not decrease with the step size, and is as small as errors of
 * constants in double precision permit. Smaller steps would only come nearer to the pose. */
int ordernm_rounded_at_pose(const ordernm_motion *m, scalar h, scalar error)
{
    if (!(m->pose > m->t && m->pose < m->t + h && fabs(m->pose - m->refused_pose) < h)) return 0;
    if (!(h < SMALLER*m->refused_step && error > LESS*m->refused_error)) return 0;
    scalar condition = 0.0, rate = 0.0, size = 0.0;
    for (int i = 0; i < m->method->stages; ++i)
        if (m->conditions[i] < LOST) condition = fmax(condition, m->conditions[i]);
    for (int i = 0; i < m->ny; ++i) rate = fmax(rate, fabs(m->rate[0][i])), size = fmax(size, fabs(m->z[i]));
    const scalar loops = fmax(1.0, m->system->nloops), rounded = BY_CONSTANTS*loops*condition*condition*condition*h*rate;
    return error*(m->problem->atol[0] + m->problem->rtol*size) < rounded;
}

/* The size of a step near a pose; h is the size that the step would have elsewhere. With constant steps, one smaller step is made near the
 * pose. */
scalar ordernm_step_at_pose(const ordernm_motion *m, scalar h, scalar wall)
{
    const scalar gap = m->method->gap, left = m->pose - m->t, centred = left/gap, before = left - gap*h;
    if (!(left > 1e-3*h) || h < 0.6*left || m->pose > wall - 0.05*left) return h;
    if (!m->adaptive) {
        const scalar part = left/h;
        if (fabs(part - gap) < 0.05 || fabs(part - 1.0 + gap) < 0.05) return h;
        return part > gap + 0.1 ? left - gap*h : left/(1.0 - gap);
    }
    if (centred <= 1.05*h && m->t + centred <= wall) return centred;
    /* the next step may then have its full size, with the pose in its gap */
    return before > h ? 0.5*before : before > 0.0 && m->t + before + h <= wall ? before : 0.5*left;
}

/* ---- Results at a pose. ---- */

/* Positions near a pose, relative to the step, and weights of Lagrange's interpolation from all six and from the inner four positions. */
static const scalar OFFSETS[BESIDE] = {-0.03, -0.02, -0.01, 0.01, 0.02, 0.03};
static const scalar SIX[BESIDE] = {0.05, -0.3, 0.75, 0.75, -0.3, 0.05}, FOUR[BESIDE] = {0.0, -1.0/6, 4.0/6, 4.0/6, -1.0/6, 0.0};

/* Largest difference of the two interpolations, relative to the value or in tolerances; derivatives with a larger difference do not exist
 * at the pose. The same holds if the difference of both sides grows towards the pose, as for 1/(t - pose). */
static const scalar SAME = 1e-6, SAME_TOLERANCES = 1e3;

/* Interpolates rows and states at the pose from rows and states near the pose. Returns -1 if values do not exist. */
static int at_pose(ordernm_motion *m, scalar t, long size)
{
    const ordernm_problem *const p = m->problem;
    const long values = 1 + m->system->nq + m->system->nu + m->system->noutputs + m->nx, derivatives = ordernm_row_size(p);
    for (long i = 0; i < size; ++i) {
        const scalar *const of = m->beside + i;
        const scalar inner = fabs(of[3*size] - of[2*size]), outer = fabs(of[5*size] - of[0]);
        scalar six = 0.0, four = 0.0;
        for (int j = 0; j < BESIDE; ++j) six += SIX[j]*m->beside[j*size + i], four += FOUR[j]*m->beside[j*size + i];
        const scalar allowed = fmax(SAME, SAME_TOLERANCES*p->rtol)*(1.0 + fabs(six));
        const int same = fabs(six - four) <= allowed && inner <= outer + allowed;
        if (!same && i < values) return -1;
        m->known_row[i] = same || i >= derivatives ? six : NAN;
    }
    m->known_row[0] = t;
    m->row_known = 1;
    return 0;
}

/* Interpolates a row, and the state, at the end of a step of size h: loops have lost rank there, but the motion is smooth. Also returns
 * -1 if the steps are too large. */
int ordernm_beside(ordernm_motion *m, scalar h, ordernm_describing *describe, long size)
{
    memset(m->at_pose, 0, m->size*sizeof(scalar));
    for (int j = 0; j < BESIDE; ++j) {
        const scalar made = h*(1.0 + OFFSETS[j]);
        scalar error;
        int status = m->method->step(m, made, &error);
        if (!status) status = describe(m, m->t + made, m->next, m->beside + j*size);
        if (status || !(error <= 1.0 || m->problem->fixed)) return status ? status : -1;
        for (long i = 0; i < m->size; ++i) m->at_pose[i] += SIX[j]*m->next[i];
    }
    memcpy(m->next, m->at_pose, m->size*sizeof(scalar));
    return at_pose(m, m->t + h, size);
}

/* Interpolates a row, and the state, within the accepted step, at the fraction `part` of h, where loops have lost rank. */
int ordernm_beside_within(ordernm_motion *m, scalar h, scalar part, long size)
{
    for (int j = 0; j < BESIDE; ++j) {
        const scalar at = part + OFFSETS[j];
        m->method->interpolate(m, h, at, m->trial);
        const int status = ordernm_report(m, m->t + at*h, m->trial, m->beside + j*size);
        if (status) return status;
    }
    return at_pose(m, m->t + part*h, size);
}
