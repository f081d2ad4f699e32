/* Inputs over time, which are splines: values, time derivatives, and derivatives along directions. */
#include "inside.h"

#include <math.h>
#include <string.h>

/* The next knot after t, up to rounding. */
scalar ordernm_next_knot(const ordernm_motion *m, scalar t)
{
    const ordernm_inputs *in = &m->problem->inputs;
    if (!in->knots) return INFINITY;
    const scalar least = t + 1e-12*(fabs(t) + 1e-3);
    long low = 0, high = in->count + in->degree + 1;
    while (low < high) {
        const long at = (low + high)/2;
        if (in->knots[at] > least) high = at;
        else low = at + 1;
    }
    return low < in->count + in->degree + 1 ? in->knots[low] : INFINITY;
}

/* Calls the problem's function at a knot of the inputs. Returns 0, or REFUSED. */
int ordernm_reach_knot(ordernm_motion *m)
{
    const ordernm_problem *const p = m->problem;
    return p->at_knot && p->at_knot(p->context, m, m->t) ? REFUSED : 0;
}

/* The index of the spline's piece that contains a step: `count` after the last knot, degree - 1 before the first knot. */
void ordernm_find_segment(ordernm_motion *m, scalar t, scalar h)
{
    const ordernm_inputs *in = &m->problem->inputs;
    if (!in->knots) return;
    const scalar middle = t + 0.5*h;
    long low = in->degree, high = in->count - 1;
    while (low < high) {
        const long at = (low + high + 1)/2;
        if (in->knots[at] <= middle) low = at;
        else high = at - 1;
    }
    m->segment = middle < in->knots[in->degree] ? in->degree - 1 : middle > in->knots[in->count] ? in->count : low;
}

/* Finds the piece of the spline that follows the current time. The time may be just before a knot. */
void ordernm_find_next_segment(ordernm_motion *m)
{
    ordernm_find_segment(m, m->t, fmin(1e-9*(1.0 + fabs(m->t)), ordernm_next_knot(m, m->t) - m->t));
}

/* Values of the degree + 1 B-splines that are not zero at t, or time derivatives of the given order, by de Boor's recursion. Returns the
 * index of the first of these B-splines. */
static long b_splines(const ordernm_motion *m, scalar t, int order, scalar *value)
{
    const ordernm_inputs *in = &m->problem->inputs;
    const scalar *knot = in->knots;
    const int degree = in->degree, outside = m->segment < degree || m->segment >= in->count;
    const long at = m->segment < degree ? degree : m->segment < in->count ? m->segment : in->count - 1;
    const scalar first = knot[degree], last = knot[in->count];
    const scalar x = t < first ? first : t > last ? last : t;
    scalar left[ORDERNM_MOST_DEGREE + 1], right[ORDERNM_MOST_DEGREE + 1];
    if (order && (outside || order > degree)) {
        for (int i = 0; i <= degree; ++i) value[i] = 0.0;
        return at - degree;
    }
    value[0] = 1.0;
    for (int j = 1; j <= degree - order; ++j) {
        left[j] = x - knot[at + 1 - j];
        right[j] = knot[at + j] - x;
        scalar saved = 0.0;
        for (int i = 0; i < j; ++i) {
            const scalar part = value[i]/(right[i + 1] + left[j - i]);
            value[i] = saved + right[i + 1]*part;
            saved = left[j - i]*part;
        }
        value[j] = saved;
    }
    for (int j = degree - order + 1; j <= degree; ++j) { /* differences of splines of the next lower degree */
        scalar before = 0.0;
        for (int i = 0; i <= j; ++i) {
            const scalar *const from = knot + at - j + i;
            const scalar here = i < j ? value[i]/(from[j + 1] - from[1]) : 0.0;
            value[i] = j*(before - here);
            before = here;
        }
    }
    return at - degree;
}

/* Time derivatives of the given order of the B-splines that are not zero at t; with prescribed motion by inputs, also the next two. Returns
 * the index of the first of these B-splines. */
long ordernm_input_weights(const ordernm_motion *m, scalar t, int of_order, scalar value[ORDERNM_ORDERS][ORDERNM_MOST_DEGREE + 1])
{
    const int orders = m->system->nmoving ? ORDERNM_ORDERS : 1;
    long first = 0;
    for (int order = 0; order < orders; ++order)
        if (m->problem->inputs.knots) first = b_splines(m, t, order + of_order, value[order]);
        else value[order][0] = order + of_order ? 0.0 : 1.0;
    return first;
}

/* The signal of which an input is the value or a derivative, and the order of that derivative. */
int ordernm_signal_of(const ordernm_system *s, int input, int *order)
{
    const int behind = input - ordernm_signals(s);
    *order = behind < 0 ? 0 : 1 + behind%2;
    return behind < 0 ? input : s->moving[behind/2];
}

/* Time derivatives of all inputs, of the given order. */
void ordernm_input_rates(ordernm_motion *m, scalar t, int of_order, scalar *rates)
{
    const ordernm_inputs *const in = &m->problem->inputs;
    const ordernm_system *const s = m->system;
    memset(rates, 0, s->ninputs*sizeof(scalar));
    if (!in->knots || !in->values) return;
    scalar value[ORDERNM_ORDERS][ORDERNM_MOST_DEGREE + 1];
    const long first = ordernm_input_weights(m, t, of_order, value);
    for (int i = 0; i < s->ninputs; ++i) {
        int order;
        const int signal = ordernm_signal_of(s, i, &order);
        for (int b = 0; b <= in->degree; ++b) rates[i] += value[order][b]*in->values[(first + b)*ordernm_signals(s) + signal];
    }
}

const scalar *ordernm_inputs_at(ordernm_motion *m, scalar t)
{
    const ordernm_inputs *in = &m->problem->inputs;
    const ordernm_system *const s = m->system;
    const int n = ordernm_signals(s);
    if (!n || !in->values) return m->inputs; /* zeros */
    if (!in->knots && !s->nmoving) return in->values;
    scalar value[ORDERNM_ORDERS][ORDERNM_MOST_DEGREE + 1];
    const long first = ordernm_input_weights(m, t, 0, value);
    for (int i = 0; i < s->ninputs; ++i) {
        int order;
        const int signal = ordernm_signal_of(s, i, &order);
        m->inputs[i] = 0.0;
        for (int b = 0; b <= in->degree; ++b) m->inputs[i] += value[order][b]*in->values[(first + b)*n + signal];
    }
    return m->inputs;
}

/* Derivatives of the inputs, or of their time derivatives of the given order, along the directions of a group. */
scalar *ordernm_input_directions(ordernm_motion *m, scalar t, const group *g, int of_order)
{
    const ordernm_inputs *in = &m->problem->inputs;
    const ordernm_system *const s = m->system;
    const int n = ordernm_signals(s), width = g->width;
    if (!n || !in->directions) return m->dinputs; /* zeros */
    scalar value[ORDERNM_ORDERS][ORDERNM_MOST_DEGREE + 1];
    const long first = ordernm_input_weights(m, t, of_order, value);
    for (int i = 0; i < s->ninputs; ++i) {
        int order;
        const int signal = ordernm_signal_of(s, i, &order);
        for (int l = 0; l < width; ++l) {
            scalar sum = 0.0;
            if (l < g->used && m->lost[(g - m->groups)*LANES + l] == 0.0)
                for (int b = 0; b <= in->degree; ++b)
                    sum += value[order][b]*in->directions[((g->first + l)*in->count + first + b)*n + signal];
            m->dinputs[i*width + l] = sum;
        }
    }
    return m->dinputs;
}
