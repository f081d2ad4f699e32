/* One state: its independent entries taken apart and put together, loops closed, inputs, rates, rows of results. */
#include "inside.h"

#include <math.h>
#include <string.h>

enum { CLOSING_STEPS = 12 };

/* What one more of Newton's steps leaves: its square, times the condition of the closure. */
static const double CLOSED = 1e-15;

/* Scaled residual that rounding may leave. */
static const double ROUNDING = 1e-13;

int ordernm_all_finite(const double *x, long n)
{
    double sum = 0.0;
    for (long i = 0; i < n; ++i) sum += 0.0*x[i];
    return sum == 0.0;
}

/* ---- Inputs. ---- */

/* The first knot behind t, with what rounding makes of it. */
double ordernm_next_knot(const ordernm_motion *m, double t)
{
    const ordernm_inputs *in = &m->problem->inputs;
    if (!in->knots) return INFINITY;
    const long n = in->count + in->degree + 1;
    const double least = t + 1e-12*(fabs(t) + 1e-3);
    for (long i = 0; i < n; ++i)
        if (in->knots[i] > least) return in->knots[i];
    return INFINITY;
}

/* The piece of the spline that a step lies in; count is behind the last knot, degree - 1 before the first. */
void ordernm_find_segment(ordernm_motion *m, double t, double h)
{
    const ordernm_inputs *in = &m->problem->inputs;
    if (!in->knots) return;
    const double middle = t + 0.5*h;
    long low = in->degree, high = in->count - 1;
    while (low < high) {
        const long at = (low + high + 1)/2;
        if (in->knots[at] <= middle) low = at;
        else high = at - 1;
    }
    m->segment = middle < in->knots[in->degree] ? in->degree - 1 : middle > in->knots[in->count] ? in->count : low;
}

/* The B-splines that are not zero at t, degree + 1 of them, or their time derivatives of some order; returns the number of the first
 * (de Boor). */
static long b_splines(const ordernm_motion *m, double t, int order, double *value)
{
    const ordernm_inputs *in = &m->problem->inputs;
    const double *knot = in->knots;
    const int degree = in->degree, outside = m->segment < degree || m->segment >= in->count;
    const long at = m->segment < degree ? degree : m->segment < in->count ? m->segment : in->count - 1;
    const double first = knot[degree], last = knot[in->count];
    const double x = t < first ? first : t > last ? last : t;
    double left[ORDERNM_MOST_DEGREE + 1], right[ORDERNM_MOST_DEGREE + 1];
    if (order && (outside || order > degree)) {
        for (int i = 0; i <= degree; ++i) value[i] = 0.0;
        return at - degree;
    }
    value[0] = 1.0;
    for (int j = 1; j <= degree - order; ++j) {
        left[j] = x - knot[at + 1 - j];
        right[j] = knot[at + j] - x;
        double saved = 0.0;
        for (int i = 0; i < j; ++i) {
            const double part = value[i]/(right[i + 1] + left[j - i]);
            value[i] = saved + right[i + 1]*part;
            saved = left[j - i]*part;
        }
        value[j] = saved;
    }
    for (int j = degree - order + 1; j <= degree; ++j) { /* differences of those of a degree less */
        double before = 0.0;
        for (int i = 0; i <= j; ++i) {
            const double *const from = knot + at - j + i;
            const double here = i < j ? value[i]/(from[j + 1] - from[1]) : 0.0;
            value[i] = j*(before - here);
            before = here;
        }
    }
    return at - degree;
}

/* The B-splines at t, and where prescribed motion reads inputs their first and second derivatives; returns the number of the first. */
long ordernm_input_weights(const ordernm_motion *m, double t, double value[ORDERNM_ORDERS][ORDERNM_MOST_DEGREE + 1])
{
    const int orders = m->system->nmoving ? ORDERNM_ORDERS : 1;
    long first = 0;
    for (int order = 0; order < orders; ++order)
        if (m->problem->inputs.knots) first = b_splines(m, t, order, value[order]);
        else value[order][0] = order ? 0.0 : 1.0;
    return first;
}

/* Which signal an input follows, and its derivative of which order it is. */
int ordernm_signal_of(const ordernm_system *s, int input, int *order)
{
    const int behind = input - ordernm_signals(s);
    *order = behind < 0 ? 0 : 1 + behind%2;
    return behind < 0 ? input : s->moving[behind/2];
}

/* Time derivatives of all inputs. */
void ordernm_input_rates(ordernm_motion *m, double t, double *rates)
{
    const ordernm_inputs *const in = &m->problem->inputs;
    const ordernm_system *const s = m->system;
    memset(rates, 0, s->ninputs*sizeof(double));
    if (!in->knots || !in->values) return;
    double value[ORDERNM_ORDERS][ORDERNM_MOST_DEGREE + 1];
    long first = 0;
    for (int order = 0; order < (s->nmoving ? ORDERNM_ORDERS : 1); ++order) first = b_splines(m, t, order + 1, value[order]);
    for (int i = 0; i < s->ninputs; ++i) {
        int order;
        const int signal = ordernm_signal_of(s, i, &order);
        for (int b = 0; b <= in->degree; ++b) rates[i] += value[order][b]*in->values[(first + b)*ordernm_signals(s) + signal];
    }
}

static const double *inputs_at(ordernm_motion *m, double t)
{
    const ordernm_inputs *in = &m->problem->inputs;
    const ordernm_system *const s = m->system;
    const int n = ordernm_signals(s);
    if (!n || !in->values) return m->inputs; /* zeros */
    if (!in->knots && !s->nmoving) return in->values;
    double value[ORDERNM_ORDERS][ORDERNM_MOST_DEGREE + 1];
    const long first = ordernm_input_weights(m, t, value);
    for (int i = 0; i < s->ninputs; ++i) {
        int order;
        const int signal = ordernm_signal_of(s, i, &order);
        m->inputs[i] = 0.0;
        for (int b = 0; b <= in->degree; ++b) m->inputs[i] += value[order][b]*in->values[(first + b)*n + signal];
    }
    return m->inputs;
}

/* Their derivatives along the directions of a group. */
static double *input_directions(ordernm_motion *m, double t, const group *g)
{
    const ordernm_inputs *in = &m->problem->inputs;
    const ordernm_system *const s = m->system;
    const int n = ordernm_signals(s), width = g->width;
    if (!n || !in->directions) return m->dinputs; /* zeros */
    double value[ORDERNM_ORDERS][ORDERNM_MOST_DEGREE + 1];
    const long first = ordernm_input_weights(m, t, value);
    for (int i = 0; i < s->ninputs; ++i) {
        int order;
        const int signal = ordernm_signal_of(s, i, &order);
        for (int l = 0; l < width; ++l) {
            double sum = 0.0;
            if (l < g->used)
                for (int b = 0; b <= in->degree; ++b)
                    sum += value[order][b]*in->directions[((g->first + l)*in->count + first + b)*n + signal];
            m->dinputs[i*width + l] = sum;
        }
    }
    return m->dinputs;
}

/* ---- Quaternions. ---- */

static double length_of(const double *e)
{
    return sqrt(e[0]*e[0] + e[1]*e[1] + e[2]*e[2] + e[3]*e[3]);
}

/* Gives a quaternion length one, and its derivatives along so many directions what they are then. */
static void normalise(double *e, double *de, int width)
{
    const double length = length_of(e);
    for (int i = 0; i < 4; ++i) e[i] /= length;
    for (int l = 0; l < width; ++l) {
        double along = 0.0;
        for (int i = 0; i < 4; ++i) {
            de[i*width + l] /= length;
            along += e[i]*de[i*width + l];
        }
        for (int i = 0; i < 4; ++i) de[i*width + l] -= e[i]*along;
    }
}

/* Newton's method turns along tangents, so it makes quaternions longer, and predictions are of any length: dependent ones have length
 * one. What a joint shares with independent entries keeps the length that these have, `before`. */
static void keep_lengths(ordernm_motion *m, const double *before)
{
    const ordernm_system *const s = m->system;
    for (int i = 0; i < s->nquaternions; ++i) {
        double *const e = m->q + s->quaternion[i];
        if (m->turned[i]) normalise(e, 0, 0);
        else if (s->split) {
            const double by = before[i]/length_of(e);
            for (int k = 0; k < 4; ++k) e[k] *= by;
        }
    }
}

/* ---- The state of the system. ---- */

/* All coordinates and speeds of a state, in m->q and m->u, the dependent ones as predicted. */
void ordernm_expand(ordernm_motion *m, const double *z)
{
    const ordernm_system *const s = m->system;
    if (m->identity) return;
    for (int i = 0; i < s->nfree_q; ++i) m->q[s->free_q[i]] = z[i];
    for (int i = 0; i < s->nfree_u; ++i) m->u[s->free_u[i]] = z[s->nfree_q + i];
    const double *predicted = z + m->ny + m->nx;
    for (int i = 0; i < m->nd; ++i) m->q[m->dependent[i]] = predicted[i];
}

/* Arguments of functions at a state; its coordinates and speeds are m->q and m->u unless z has them as they are. They are written
 * where they stay: a struct that is returned is copied in vectors right after its parts were written, for which processors wait. */
void ordernm_arguments(ordernm_motion *m, double t, const double *z, ordernm_call *c)
{
    ordernm_expand(m, z);
    memset(c, 0, sizeof *c);
    c->p = m->problem->p;
    c->t = t;
    c->dt = m->dt;
    c->modes = m->modes;
    c->work = m->work;
    c->precise_work = m->precise_work;
    c->inputs = inputs_at(m, t);
    c->q = m->identity ? z : m->q;
    c->u = m->identity ? z + m->system->nq : m->u;
}

/* A row of as many numbers as there are lanes; sizes that compilers know cost no call. */
static inline void copy_lanes(double *to, const double *from, int width)
{
    if (width == 1) *to = *from;
    else if (width == LANES) memcpy(to, from, LANES*sizeof(double));
    else memcpy(to, from, LANES/2*sizeof(double));
}

/* Seeds of a group. */
void ordernm_seeds(ordernm_motion *m, double t, const double *z, const group *g, ordernm_call *c)
{
    const ordernm_system *s = m->system;
    const int width = g->width;
    double *S = (double *)z + g->at;
    c->dp = g->dp;
    c->dinputs = input_directions(m, t, g);
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

/* By how much dropped conditions are open where residuals were computed last. */
static void note_dropped(ordernm_motion *m)
{
    const ordernm_system *const s = m->system;
    m->apart = 0.0;
    for (int i = 0; i < s->ndropped; ++i) {
        const double x = fabs(m->position[s->dropped[i]]);
        if (!(x <= m->apart)) m->apart = x, m->widest = s->dropped[i];
    }
}

static double largest_residual(const ordernm_motion *m)
{
    double largest = 0.0;
    for (int i = 0; i < m->system->nkept; ++i) {
        const double x = fabs(m->position[m->system->kept[i]]);
        if (!(x <= largest)) largest = x;
    }
    return largest;
}

/* Closes the loops of m->q by Newton's method, in long double where rounding of the conditions would move the dependent
 * coordinates by too much, and says in m->precise whether derivatives are to be computed so, too, and in m->precise_values whether
 * rates are. Returns 0, what the function returned, or -1 if they do not close. */
int ordernm_close_loops(ordernm_motion *m, ordernm_call *c)
{
    const ordernm_system *s = m->system;
    if (!s->closing_step) return 0;
    ordernm_function *closing_step = s->closing_step;
    double before = INFINITY;
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
        const double residual = largest_residual(m);
        const int no_better = !(residual < 0.5*before);
        if (no_better && residual > fmax(ROUNDING, s->slack)) return -1;
        double step = 0.0;
        for (int i = 0; i < s->nq; ++i) {
            m->q[i] += m->newton[i];
            if (!(fabs(m->newton[i]) <= step)) step = fabs(m->newton[i]);
        }
        keep_lengths(m, m->lengths);
        double condition = 1.0;
        for (int i = 0; i < s->nloops; ++i)
            if (!(m->condition[i] <= condition)) condition = m->condition[i];
        if (condition > m->results->condition) m->results->condition = condition;
        m->results->condition_here = condition;
        before = residual;
        m->precise = condition > m->poor_rates || precisely;
        m->precise_values = m->method->gives_rate ? m->precise : precisely; /* implicit methods solve with both */
        if (m->precise && !s->precise) m->imprecise = 1, m->precise = m->precise_values = 0;
        if (condition > m->poor && !precisely && s->precise) {
            precisely = 1;
            closing_step = s->precise->closing_step;
            before = INFINITY;
            continue;
        }
        /* where conditions imply each other only nearly, what is left of them stays */
        if ((no_better && residual <= ROUNDING) || step*step*condition <= CLOSED) {
            if (s->ndropped) note_dropped(m);
            return 0;
        }
    }
    return -1;
}

/* ---- Rates. ---- */

/* Time derivatives of z and of its derivatives along some groups; all coordinates, loops closed, are in m->q then. Loops that are
 * known to be closed are as predictions say. Returns 0, what a function returned, or -1 if loops do not close. */
int ordernm_rates_of(ordernm_motion *m, double t, const double *z, double *rate, int ngroups, const group *groups, int what)
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
    const int apart = m->precise != m->precise_values; /* values are not those that come with derivatives */
    if (rates && !ngroups && (status = ORDERNM_VALUES_OF(m, state_rates)(&c))) return status;
    for (int n = 0; n < ngroups; ++n) {
        const group *g = groups + n;
        double *S = rate + g->at;
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
        double *predicted = rate + m->ny + m->nx;
        for (int i = 0; i < m->nd; ++i) predicted[i] = m->qdot[m->dependent[i]];
    }
    return 0;
}

int ordernm_rates(ordernm_motion *m, double t, const double *z, double *rate)
{
    return ordernm_rates_of(m, t, z, rate, m->ngroups, m->groups, RATES | INTEGRALS);
}

/* The same at a step's end, from which the next one begins: its loops need not be closed a second time. */
int ordernm_rates_at_end(ordernm_motion *m, double t, double *rate)
{
    const int status = ordernm_rates(m, t, m->next, rate);
    m->precise_at_end = m->precise;
    if (status || m->identity) return status;
    memcpy(m->closed, m->q, m->system->nq*sizeof(double));
    m->closed_condition = m->results->condition_here;
    m->closed_known = 1;
    m->apart_at_end = m->apart;
    return 0;
}

/* ---- Between steps. ---- */

/* What is done with a state between two steps: predictions become what closure asks for, and so do independent entries that a
 * joint shares with dependent ones. Returns 1 if more than predictions has changed: rates are computed anew then; -1 if loops do
 * not close. */
int ordernm_settle(ordernm_motion *m, double t, double *z)
{
    const ordernm_system *s = m->system;
    if (m->identity) return 0;
    ordernm_call c;
    ordernm_arguments(m, t, z, &c);
    if (m->closed_known) {
        memcpy(m->q, m->closed, s->nq*sizeof(double));
        m->results->condition_here = m->closed_condition;
        m->precise = m->precise_at_end;
        m->closed_known = 0;
    } else if (ordernm_close_loops(m, &c)) {
        return -1;
    }
    double *predicted = z + m->ny + m->nx;
    for (int i = 0; i < m->nd; ++i) predicted[i] = m->q[m->dependent[i]];
    if (!s->split) return 0;
    for (int i = 0; i < s->nfree_q; ++i) z[i] = m->q[s->free_q[i]];
    c.full_u = m->qdot; /* as long as it is needed, and not needed itself */
    for (int n = 0; n < m->ngroups; ++n) {
        const group *g = m->groups + n;
        const int width = g->width;
        double *S = z + g->at;
        ordernm_seeds(m, t, z, g, &c);
        c.dfull_q = m->full_dq;
        c.dfull_u = m->full_du;
        if (ORDERNM_OF(m, completion_sensitivities[g->index])(&c)) return -1;
        for (int i = 0; i < s->nfree_q; ++i) copy_lanes(S + i*width, m->full_dq + s->free_q[i]*width, width);
    }
    return 1;
}

/* Arguments of sensitivities at a state, loops closed, whose one direction is time: along rates of the independent entries. Returns
 * what a function returned, or -1 if loops do not close. */
int ordernm_along_time(ordernm_motion *m, double t, const double *z, const double *rate, ordernm_call *c)
{
    static const double one[LANES] = {1.0};
    const ordernm_system *const s = m->system;
    ordernm_arguments(m, t, z, c);
    const int status = ordernm_close_loops(m, c);
    if (status) return status;
    for (int i = 0; i < s->nfree_q; ++i) m->dq[s->free_q[i]] = rate[i];
    for (int i = 0; i < s->nfree_u; ++i) m->du[s->free_u[i]] = rate[s->nfree_q + i];
    ordernm_input_rates(m, t, m->input_rates);
    c->dq = m->dq, c->du = m->du, c->dp = m->no_dp, c->dinputs = m->input_rates, c->dt = (double *)one;
    return 0;
}

/* ---- Results. ---- */

/* Time derivatives of all coordinates, of quaternions of length one, of speeds and of outputs. */
int ordernm_report_rates(ordernm_motion *m, double t, const double *z, double *rates)
{
    const ordernm_system *const s = m->system;
    double *const qdot = rates, *const udot = qdot + s->nq, *const outputs = udot + s->nu;
    int status = ordernm_rates_of(m, t, z, m->trial, 0, 0, RATES);
    if (status) return status;
    memcpy(qdot, m->identity ? m->trial : m->qdot, s->nq*sizeof(double));
    memcpy(udot, m->identity ? m->trial + s->nq : m->udot, s->nu*sizeof(double));
    const double *const q = m->identity ? z : m->q;
    for (int i = 0; i < s->nquaternions; ++i) {
        double e[4];
        memcpy(e, q + s->quaternion[i], sizeof e);
        normalise(e, qdot + s->quaternion[i], 1);
    }
    for (int i = 0; i < s->noutputs; ++i) outputs[i] = NAN;
    if (!s->output_sensitivities[ORDERNM_ONE]) return 0;
    ordernm_call c;
    if ((status = ordernm_along_time(m, t, z, m->trial, &c))) return status;
    c.outputs = m->outputs, c.doutputs = m->doutputs;
    if ((status = ORDERNM_OF(m, output_sensitivities[ORDERNM_ONE])(&c))) return status;
    memcpy(outputs, m->doutputs, s->noutputs*sizeof(double));
    return 0;
}

/* A row of results at a state: its loops closed, quaternions of length one. */
int ordernm_report(ordernm_motion *m, double t, const double *z, double *row)
{
    const ordernm_system *s = m->system;
    const ordernm_problem *p = m->problem;
    ordernm_call c;
    ordernm_arguments(m, t, z, &c);
    int status = ordernm_close_loops(m, &c);
    if (status) return status;
    double *q = row + 1, *u = q + s->nq, *outputs = u + s->nu, *integrals = outputs + s->noutputs;
    double *dq = integrals + m->nx, *du = dq + (long)p->ndirections*s->nq, *doutputs = du + (long)p->ndirections*s->nu;
    double *dintegrals = doutputs + (long)p->ndirections*s->noutputs;
    row[0] = t;
    memcpy(q, c.q, s->nq*sizeof(double));
    memcpy(u, c.u, s->nu*sizeof(double));
    for (int i = 0; i < s->nquaternions; ++i) normalise(q + s->quaternion[i], 0, 0);
    if (!m->identity) {
        c.full_u = u;
        if ((status = ORDERNM_OF(m, completion)(&c))) return status;
    }
    if (s->noutputs && s->outputs) {
        c.outputs = outputs;
        if ((status = ORDERNM_OF(m, outputs)(&c))) return status;
    }
    for (int i = 0; i < m->nx; ++i) integrals[i] = z[m->ny + i];
    for (int n = 0; n < m->ngroups; ++n) {
        const group *g = m->groups + n;
        const int width = g->width;
        double *S = (double *)z + g->at;
        ordernm_seeds(m, t, z, g, &c);
        double *of_q = c.dq, *of_u = c.du;
        if (!m->identity) {
            c.full_u = m->qdot;
            c.dfull_q = of_q = m->full_dq;
            c.dfull_u = of_u = m->full_du;
            if ((status = ORDERNM_OF(m, completion_sensitivities[g->index])(&c))) return status;
        } else if (s->nquaternions) {
            memcpy(m->full_dq, of_q, s->nq*width*sizeof(double));
            of_q = m->full_dq;
        }
        for (int i = 0; i < s->nquaternions; ++i) {
            double e[4];
            memcpy(e, c.q + s->quaternion[i], sizeof e);
            normalise(e, of_q + s->quaternion[i]*width, width);
        }
        if (s->noutputs && s->output_sensitivities[g->index]) {
            c.outputs = m->outputs;
            c.doutputs = m->doutputs;
            if ((status = ORDERNM_OF(m, output_sensitivities[g->index])(&c))) return status;
        }
        for (int l = 0; l < g->used; ++l) {
            const long k = g->first + l;
            for (int i = 0; i < s->nq; ++i) dq[k*s->nq + i] = of_q[i*width + l];
            for (int i = 0; i < s->nu; ++i) du[k*s->nu + i] = of_u[i*width + l];
            for (int i = 0; i < s->noutputs; ++i) doutputs[k*s->noutputs + i] = m->doutputs[i*width + l];
            for (int i = 0; i < m->nx; ++i) dintegrals[k*m->nx + i] = S[(m->ny + i)*width + l];
            if (m->lost[n*LANES + l] == 0.0) continue;
            for (int i = 0; i < s->nq; ++i) dq[k*s->nq + i] = NAN;
            for (int i = 0; i < s->nu; ++i) du[k*s->nu + i] = NAN;
            for (int i = 0; i < s->noutputs; ++i) doutputs[k*s->noutputs + i] = NAN;
            for (int i = 0; i < m->nx; ++i) dintegrals[k*m->nx + i] = NAN;
        }
    }
    return 0;
}
