/* One state: packing and unpacking its independent entries, closing loops, inputs, rates. */
#include "inside.h"

#include <math.h>
#include <string.h>

enum { CLOSING_STEPS = 12 };

/* Loops count as closed if the expected change by one more Newton step is smaller: the square of this step, times the condition number. */
static const scalar CLOSED = 1e-15;

/* Scaled residual due to rounding of coordinates; angles after many turns are less accurate. */
static const scalar ROUNDING = 1e-13;

/* ---- Quaternions. ---- */

static scalar length_of(const scalar *e)
{
    return sqrt(e[0]*e[0] + e[1]*e[1] + e[2]*e[2] + e[3]*e[3]);
}

/* Normalises a quaternion, and its derivatives along `width` directions. */
void ordernm_normalise(scalar *e, scalar *de, int width)
{
    const scalar length = length_of(e);
    for (int i = 0; i < 4; ++i) e[i] /= length;
    for (int l = 0; l < width; ++l) {
        scalar along = 0.0;
        for (int i = 0; i < 4; ++i) {
            de[i*width + l] /= length;
            along += e[i]*de[i*width + l];
        }
        for (int i = 0; i < 4; ++i) de[i*width + l] -= e[i]*along;
    }
}

/* Newton's steps along tangents increase the norm of quaternions, and predictions have any norm: dependent quaternions are normalised. If a
 * quaternion also has independent entries, it keeps the norm `before`. */
static void keep_lengths(ordernm_motion *m, const scalar *before)
{
    const ordernm_system *const s = m->system;
    for (int i = 0; i < s->nquaternions; ++i) {
        scalar *const e = m->q + s->quaternion[i];
        if (m->turned[i]) ordernm_normalise(e, 0, 0);
        else if (s->split) {
            const scalar by = before[i]/length_of(e);
            for (int k = 0; k < 4; ++k) e[k] *= by;
        }
    }
}

/* ---- Arguments of the system's functions. ---- */

/* Writes all coordinates and speeds of a state to m->q and m->u; dependent coordinates are the predictions. */
void ordernm_expand(ordernm_motion *m, const scalar *z)
{
    const ordernm_system *const s = m->system;
    if (m->identity) return;
    for (int i = 0; i < s->nfree_q; ++i) m->q[s->free_q[i]] = z[i];
    for (int i = 0; i < s->nfree_u; ++i) m->u[s->free_u[i]] = z[s->nfree_q + i];
    const scalar *predicted = z + m->ny + m->nx;
    for (int i = 0; i < m->nd; ++i) m->q[m->dependent[i]] = predicted[i];
}

/* Writes the arguments of functions at a state to c: m->q and m->u, or parts of z if its layout is the same. A returned struct would be
 * copied right after its parts were written, which stalls processors. */
void ordernm_arguments(ordernm_motion *m, scalar t, const scalar *z, ordernm_call *c)
{
    ordernm_expand(m, z);
    memset(c, 0, sizeof *c);
    c->p = m->p;
    c->t = t;
    c->dt = m->dt;
    c->modes = m->modes;
    c->work = m->work;
    c->precise_work = m->precise_work;
    c->inputs = ordernm_inputs_at(m, t);
    c->q = m->identity ? z : m->q;
    c->u = m->identity ? z + m->system->nq : m->u;
}

/* Copies `width` numbers; for constant widths, compilers avoid a call. */
static inline void copy_lanes(scalar *to, const scalar *from, int width)
{
    if (width == 1) *to = *from;
    else if (width == LANES) memcpy(to, from, LANES*sizeof(scalar));
    else memcpy(to, from, LANES/2*sizeof(scalar));
}

static const scalar one[LANES] = {1.0};

/* Seeds of a group of directions. */
void ordernm_seeds(ordernm_motion *m, scalar t, const scalar *z, const group *g, ordernm_call *c)
{
    const ordernm_system *s = m->system;
    const int width = g->width;
    scalar *S = (scalar *)z + g->at;
    c->dp = g->dp;
    if (g - m->groups == m->ngroups) {
        ordernm_input_rates(m, t, 1, m->input_rates);
        c->dinputs = m->input_rates, c->dt = (scalar *)one;
    } else {
        c->dinputs = ordernm_input_directions(m, t, g, 0);
    }
    if (m->identity) {
        c->dq = S;
        c->du = S + s->nq*width;
        return;
    }
    for (int i = 0; i < s->nfree_q; ++i) copy_lanes(m->dq + s->free_q[i]*width, S + i*width, width);
    for (int i = 0; i < s->nfree_u; ++i) copy_lanes(m->du + s->free_u[i]*width, S + (s->nfree_q + i)*width, width);
    c->dq = m->dq;
    c->du = m->du;
}

/* Records the residual of dropped conditions. */
static void note_dropped(ordernm_motion *m)
{
    const ordernm_system *const s = m->system;
    m->apart = 0.0;
    for (int i = 0; i < s->ndropped; ++i) {
        const scalar x = fabs(m->position[s->dropped[i]]);
        if (!(x <= m->apart)) m->apart = x, m->widest = s->dropped[i];
    }
}

static scalar largest_residual(const ordernm_motion *m)
{
    scalar largest = 0.0;
    for (int i = 0; i < m->system->nkept; ++i) {
        const scalar x = fabs(m->position[m->system->kept[i]]);
        if (!(x <= largest)) largest = x;
    }
    return largest;
}

static scalar left_by_rounding(const ordernm_motion *m)
{
    scalar largest = 1.0;
    for (int i = 0; i < m->system->nq; ++i) largest = fmax(largest, fabs(m->q[i]));
    return ROUNDING*largest;
}

/* Closes the loops of m->q by Newton's method, in long double if rounding of the conditions would move the dependent coordinates by too
 * much. Sets m->precise if derivatives, and m->precise_values if rates, are to be computed in long double. Returns 0, the status of the
 * function, or -1 if the loops do not close. */
int ordernm_close_loops(ordernm_motion *m, ordernm_call *c)
{
    const ordernm_system *s = m->system;
    if (!s->closing_step) return 0;
    ordernm_function *closing_step = s->closing_step;
    scalar before = INFINITY;
    int precisely = m->precise = m->precise_values = 0;
    c->step = m->newton;
    c->position = m->position;
    c->condition = m->condition;
    for (int i = 0; i < s->nquaternions; ++i) m->lengths[i] = length_of(m->q + s->quaternion[i]);
    keep_lengths(m, m->lengths);
    for (int n = 0; n < CLOSING_STEPS; ++n) {
        ++m->results->closing_steps;
        const int singular = closing_step(c);
        if (singular) return singular;
        const scalar residual = largest_residual(m);
        const int no_better = !(residual < 0.5*before);
        const int is_rounding = no_better && residual <= left_by_rounding(m);
        if (no_better && !is_rounding && residual > s->slack) return -1;
        scalar step = 0.0;
        for (int i = 0; i < s->nq; ++i) {
            m->q[i] += m->newton[i];
            if (!(fabs(m->newton[i]) <= step)) step = fabs(m->newton[i]);
        }
        keep_lengths(m, m->lengths);
        scalar condition = 1.0;
        for (int i = 0; i < s->nloops; ++i)
            if (!(m->condition[i] <= condition)) condition = m->condition[i];
        if (condition > m->results->condition) m->results->condition = condition;
        m->results->condition_here = condition;
        before = residual;
        m->precise = condition > m->poor_rates || precisely;
        m->precise_values = m->method->gives_rate ? m->precise : precisely; /* implicit methods need values and derivatives of equal precision */
        if (m->precise && !s->precise) m->imprecise = 1, m->precise = m->precise_values = 0;
        if (condition > m->poor && !precisely && s->precise) {
            precisely = 1;
            closing_step = s->precise->closing_step;
            before = INFINITY;
            continue;
        }
        /* nearly redundant conditions keep a residual */
        if (is_rounding || step*step*condition <= CLOSED) {
            if (s->ndropped) note_dropped(m);
            return 0;
        }
    }
    return -1;
}

/* ---- Rates. ---- */

/* Time derivatives of z, and of its derivatives along some groups; leaves all coordinates, with closed loops, in m->q. Loops that are known
 * to be closed keep the predicted coordinates. Returns 0, the status of a function, or -1 if loops do not close. */
int ordernm_rates_of(ordernm_motion *m, scalar t, const scalar *z, scalar *rate, int ngroups, const group *groups, int what)
{
    const ordernm_system *s = m->system;
    const ordernm_problem *p = m->problem;
    ordernm_call c;
    ordernm_arguments(m, t, z, &c);
    const int closed = what & KNOWN_CLOSED && !s->split;
    int status = closed ? 0 : ordernm_close_loops(m, &c);
    if (status) return status;
    if (closed) m->precise = m->precise_values = (what & PRECISE) != 0;
    const int rates = what & RATES, integrals = what & INTEGRALS && m->nx;
    if (rates) ++m->results->evaluations;
    c.qdot = m->identity ? rate : m->qdot;
    c.udot = m->identity ? rate + s->nq : m->udot;
    const int apart = m->precise != m->precise_values; /* values have another precision than derivatives */
    if (rates && !ngroups && (status = ORDERNM_VALUES_OF(m, state_rates)(&c))) return status;
    for (int n = 0; n < ngroups; ++n) {
        const group *g = groups + n;
        scalar *S = rate + g->at;
        const int width = g->width;
        ordernm_seeds(m, t, z, g, &c);
        c.dqdot = m->identity ? S : m->dqdot;
        c.dudot = m->identity ? S + s->nq*width : m->dudot;
        if (rates && (status = ORDERNM_OF(m, state_rate_sensitivities[g->index])(&c))) return status;
        if (rates && !m->identity) {
            for (int i = 0; i < s->nfree_q; ++i) copy_lanes(S + i*width, m->dqdot + s->free_q[i]*width, width);
            for (int i = 0; i < s->nfree_u; ++i)
                copy_lanes(S + (s->nfree_q + i)*width, m->dudot + s->free_u[i]*width, width);
        }
        if (integrals) {
            c.outputs = m->outputs;
            c.doutputs = m->doutputs;
            if ((status = ORDERNM_OF(m, output_sensitivities[g->index])(&c))) return status;
            for (int i = 0; i < m->nx; ++i)
                copy_lanes(S + (m->ny + i)*width, m->doutputs + p->integrals[i]*width, width);
        }
    }
    if (rates && ngroups && apart && (status = ORDERNM_VALUES_OF(m, state_rates)(&c))) return status;
    if (integrals) {
        if (!ngroups || apart) {
            c.outputs = m->outputs;
            if ((status = ORDERNM_VALUES_OF(m, outputs)(&c))) return status;
        }
        for (int i = 0; i < m->nx; ++i) rate[m->ny + i] = m->outputs[p->integrals[i]];
    }
    if (rates && !m->identity) {
        for (int i = 0; i < s->nfree_q; ++i) rate[i] = m->qdot[s->free_q[i]];
        for (int i = 0; i < s->nfree_u; ++i) rate[s->nfree_q + i] = m->udot[s->free_u[i]];
        scalar *predicted = rate + m->ny + m->nx;
        for (int i = 0; i < m->nd; ++i) predicted[i] = m->qdot[m->dependent[i]];
    }
    return 0;
}

int ordernm_rates(ordernm_motion *m, scalar t, const scalar *z, scalar *rate)
{
    return ordernm_rates_of(m, t, z, rate, m->ngroups + m->flowing, m->groups, RATES | INTEGRALS);
}

/* Rates at the end of a step. The next step starts there, and need not close the loops a second time. */
int ordernm_rates_at_end(ordernm_motion *m, scalar t, scalar *rate)
{
    const int status = ordernm_rates(m, t, m->next, rate);
    m->precise_at_end = m->precise;
    if (status || m->identity) return status;
    memcpy(m->closed, m->q, m->system->nq*sizeof(scalar));
    m->closed_condition = m->results->condition_here;
    m->closed_known = 1;
    m->apart_at_end = m->apart;
    return 0;
}

/* ---- Between steps. ---- */

/* Adjusts a state between two steps: predictions, and independent entries of joints that also have dependent ones, become consistent with
 * closure. Returns 1 if more than predictions has changed, so that rates must be computed again; -1 if loops do not close. */
int ordernm_settle(ordernm_motion *m, scalar t, scalar *z)
{
    const ordernm_system *s = m->system;
    if (m->identity) return 0;
    ordernm_call c;
    ordernm_arguments(m, t, z, &c);
    if (m->closed_known) {
        memcpy(m->q, m->closed, s->nq*sizeof(scalar));
        m->results->condition_here = m->closed_condition;
        m->precise = m->precise_at_end;
        m->closed_known = 0;
    } else if (ordernm_close_loops(m, &c)) {
        return -1;
    }
    scalar *predicted = z + m->ny + m->nx;
    for (int i = 0; i < m->nd; ++i) predicted[i] = m->q[m->dependent[i]];
    if (!s->split) return 0;
    for (int i = 0; i < s->nfree_q; ++i) z[i] = m->q[s->free_q[i]];
    c.full_u = m->qdot; /* used as memory here */
    for (int n = 0; n < m->ngroups; ++n) {
        const group *g = m->groups + n;
        const int width = g->width;
        scalar *S = z + g->at;
        ordernm_seeds(m, t, z, g, &c);
        c.dfull_q = m->full_dq;
        c.dfull_u = m->full_du;
        if (ORDERNM_OF(m, completion_sensitivities[g->index])(&c)) return -1;
        for (int i = 0; i < s->nfree_q; ++i) copy_lanes(S + i*width, m->full_dq + s->free_q[i]*width, width);
    }
    return 1;
}

/* Arguments of sensitivities at a state with closed loops, with time as the only direction: along the rates of the independent entries.
 * Returns the status of a function, or -1 if loops do not close. */
int ordernm_along_time(ordernm_motion *m, scalar t, const scalar *z, const scalar *rate, ordernm_call *c)
{
    const ordernm_system *const s = m->system;
    ordernm_arguments(m, t, z, c);
    const int status = ordernm_close_loops(m, c);
    if (status) return status;
    for (int i = 0; i < s->nfree_q; ++i) m->dq[s->free_q[i]] = rate[i];
    for (int i = 0; i < s->nfree_u; ++i) m->du[s->free_u[i]] = rate[s->nfree_q + i];
    ordernm_input_rates(m, t, 1, m->input_rates);
    c->dq = m->dq, c->du = m->du, c->dp = m->no_dp, c->dinputs = m->input_rates, c->dt = (scalar *)one;
    return 0;
}

/* ---- Condition numbers. ---- */

/* Records the condition numbers of the loops at a stage of a step, or at its end. */
void ordernm_note_condition(ordernm_motion *m, int stage, int status)
{
    const int n = m->system->nloops;
    m->conditions[stage] = status ? LOST : m->results->condition_here;
    if (m->identity) return;
    for (int i = 0; i < n; ++i) m->ranks[stage*n + i] = status ? 0.0 : 1.0/m->condition[i];
}
