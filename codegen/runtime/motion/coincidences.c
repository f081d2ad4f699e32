/* Events, or knots of the inputs, at the same time as a switch at which rates or outputs jump: derivatives may depend on the order. */
#include "inside.h"

#include <math.h>
#include <string.h>

/* A switching function below ROUNDED counts as zero; jumps whose relative difference is below SAME_JUMP count as equal. */
static const scalar ROUNDED = 1e-12, SAME_JUMP = 1e-9;

static int apart(scalar a, scalar b, scalar size) { return !(fabs(a - b) <= ORDER_MATTERS*size + 1e-10*(fabs(a) + fabs(b))); }

/* Sets derivatives in an event's row to NaN if they depend on the order of event and switch. `one` and `other` are the event's rows on both
 * sides of the switch. Returns whether any derivative became NaN. */
static int compare_sides(const ordernm_motion *m, int e, scalar *row, const scalar *one, const scalar *other)
{
    const ordernm_problem *const p = m->problem;
    const ordernm_system *const s = m->system;
    const int n = s->nq + s->nu + s->noutputs, sizes[] = {s->nq, s->nu, s->noutputs};
    const long rates = ordernm_row_size(p), of_event = s->nq + s->nu + p->events[e].output;
    int lost = 0;
    for (int k = 0; k < p->ndirections; ++k) {
        const long own = 1 + n + m->nx + (long)p->ndirections*(s->nq + s->nu) + (long)k*s->noutputs + p->events[e].output;
        const scalar here = -one[own]/one[rates + of_event], there = -other[own]/other[rates + of_event];
        const scalar size = fabs(here) + fabs(there), switched = m->passing_time[k/LANES*LANES + k%LANES];
        const int all = apart(here, there, size), first = apart(here, switched, size + fabs(switched));
        long at = 1 + n + m->nx, value = 1;
        for (int part = 0; part < 3; at += (long)p->ndirections*sizes[part], ++part)
            for (int i = 0; i < sizes[part]; ++i, ++value) {
                const long d = at + (long)k*sizes[part] + i;
                const scalar by = one[rates + value - 1]*here, then = other[rates + value - 1]*there;
                const int jumps = apart(one[value], other[value], fabs(one[value]) + fabs(other[value]));
                const scalar all_sizes = fabs(one[d]) + fabs(other[d]) + fabs(by) + fabs(then);
                if (!all && !(jumps && first) && !apart(one[d] + by, other[d] + then, all_sizes)) continue;
                row[d] = NAN;
                lost = 1;
            }
    }
    return lost;
}

/* Records an event at the same time as a switch. */
static void note_coincidence(ordernm_motion *m, int e, int lost)
{
    ordernm_results *const r = m->results;
    r->event_together = 1 + e;
    r->together_with = 1 + m->together[m->ntogether - 1];
    r->together_at = m->t;
    r->event_ordered |= lost;
}

/* Whether an event counts as simultaneous with the switches passed last: within AT_THE_SAME_TIME, or because errors of the state may
 * reverse the order. The state is that of the event or of the switches. */
static int coincides(ordernm_motion *m, int e, const scalar *row, scalar t, const scalar *z)
{
    const ordernm_problem *const p = m->problem;
    const ordernm_system *const s = m->system;
    const int output = p->events[e].output;
    const scalar rate = row[ordernm_row_size(p) + s->nq + s->nu + output];
    scalar error[2];
    if (fabs(row[0] - m->together_since) <= AT_THE_SAME_TIME*(p->end - p->start)) return 1;
    if (ordernm_find_switch_errors(m, t, z) || ordernm_find_output_error(m, t, z, output, error)) return 0;
    for (int i = 0; i < m->ntogether; ++i)
        if (ordernm_may_precede(m, fabs(row[0] - m->changed[m->together[i]]), error, rate, m->together[i])) return 1;
    return 0;
}

/* An event's row at the values of a state, but with the modes, and the derivatives of the state, before (`before`) or after the switches
 * passed last. Returns the status of a function. */
static int describe_side(ordernm_motion *m, scalar t, const scalar *values, int before, scalar *row)
{
    const size_t size = m->system->nswitches*sizeof(scalar);
    scalar *const z = m->error[0];
    memcpy(z, values, m->values*sizeof(scalar));
    memcpy(z + m->values, (before ? m->z_before : m->z_after) + m->values, (m->size - m->values)*sizeof(scalar));
    memcpy(m->switches_kept, m->modes, size);
    for (int i = 0; i < m->ntogether && before; ++i) m->modes[m->together[i]] = m->modes_before[m->together[i]];
    const int status = ordernm_describe(m, t, z, row);
    memcpy(m->modes, m->switches_kept, size);
    return status;
}

/* Compares an event's rows on both sides of the switches, at the state of the event or of the switches. */
static int compare_at(ordernm_motion *m, int e, scalar *row, scalar t, const scalar *z)
{
    if (!coincides(m, e, row, t, z)) return 0;
    int status = describe_side(m, t, z, 1, m->row);
    if (!status) status = describe_side(m, t, z, 0, m->known_row);
    if (!status) note_coincidence(m, e, compare_sides(m, e, row, m->row, m->known_row));
    return status;
}

/* Compares an event at the end of a step with the switches passed just before. Returns the status of a function. */
int ordernm_compare_with_front(ordernm_motion *m, int e, scalar *row)
{
    if (!m->ntogether || m->row_known || !(m->ngroups || m->results->steps)) return 0;
    return compare_at(m, e, row, row[0], m->next);
}

/* Compares the switches that have just been passed with the events that were stored just before them. Returns the status of a function. */
int ordernm_compare_events(ordernm_motion *m)
{
    ordernm_results *const r = m->results;
    const long size = ordernm_event_size(m->problem), first = r->events_count - 2L*m->problem->nevents;
    int status = 0;
    for (long i = r->events_count - 1; i >= 0 && i >= first && (m->ngroups || r->steps) && !status; --i) {
        scalar *const row = r->events + i*size;
        if (row[size - 1] >= 0.0) status = compare_at(m, r->which[i], row, m->t, m->z);
    }
    return status;
}

/* ---- Knots. ---- */

/* The jump of derivatives per unit of the switching function, (f- - f+)/g', at a switch that is passed from the given mode. Returns the
 * status of a function. */
static int jump_from(ordernm_motion *m, int k, scalar mode, scalar *jump)
{
    scalar *const after = m->trial, speed;
    m->modes[k] = mode;
    int status = ordernm_rates_of(m, m->t, m->z, jump, 0, 0, RATES | INTEGRALS);
    if (!status) status = ordernm_switch_speed(m, m->t, m->z, jump, k, &speed);
    m->modes[k] = -mode;
    if (!status) status = ordernm_rates_of(m, m->t, m->z, after, 0, 0, RATES | INTEGRALS);
    const int jumps = !status && ordernm_rates_jump(m, jump, after);
    for (int i = 0; i < m->ny + m->nx; ++i) jump[i] = jumps ? (jump[i] - after[i])/speed : 0.0;
    return status;
}

/* Whether a switch is so near to a knot of the inputs that errors of the state may reverse their order, and derivatives after both depend
 * on this order. `before` is the spline's piece before the knot; errors of switching functions must be known. */
static int depends_on_knot(ordernm_motion *m, int k, long before)
{
    const scalar mode = m->modes[k], near = fmax(ROUNDED, ordernm_switch_error(m, k));
    const long after = m->segment;
    scalar *const jumps[] = {m->error[0], m->error[1]}, speed = 0.0, size = 0.0, apart = 0.0;
    int status = ordernm_switching(m, m->t, m->z);
    if (status || fabs(m->switches[k]) > near) return 0;
    m->segment = before;
    status = ordernm_rates_of(m, m->t, m->z, m->trial, 0, 0, RATES);
    if (!status) status = ordernm_switch_speed(m, m->t, m->z, m->trial, k, &speed);
    const int continuous = fabs(m->switches[k]) <= near;
    for (int n = 0; n < 2 && continuous && !status; ++n) {
        m->segment = n ? after : before;
        status = jump_from(m, k, mode*speed < 0.0 ? mode : -mode, jumps[n]);
    }
    m->segment = after;
    m->modes[k] = mode;
    for (int i = 0; i < m->ny + m->nx && continuous && !status; ++i) {
        size = fmax(size, fabs(jumps[0][i]) + fabs(jumps[1][i]));
        apart = fmax(apart, fabs(jumps[0][i] - jumps[1][i]));
    }
    return apart > SAME_JUMP*size;
}

/* Adds a switch to m->bent if derivatives depend on whether it comes before or after a knot of the inputs. `before` is the spline's piece
 * before the knot. */
void ordernm_look_beside_knot(ordernm_motion *m, long before)
{
    if (!(m->ngroups || m->results->steps) || ordernm_find_switch_errors(m, m->t, m->z)) return;
    for (int i = 0; i < m->nheld; ++i) {
        const int k = m->held[i];
        int known = m->modes[k] == 0.0 || m->system->switch_kind[k] > ORDERNM_ROOT;
        for (int n = 0; n < m->nbent; ++n) known |= m->bent[n] == k;
        if (!known && depends_on_knot(m, k, before)) m->bent[m->nbent++] = k;
    }
}
