/* Results of a motion: rows at times within a step, stored steps for the adjoint, and the reason for the end. */
#include "inside.h"

#include <math.h>
#include <string.h>

/* Records why rates could not be computed. */
int ordernm_failed(ordernm_results *r, int status)
{
    if (status == SLIDES) return ORDERNM_SLIDING;
    if (status == REFUSED) return ORDERNM_REFUSED;
    r->singular = status;
    return status < 0 ? ORDERNM_OPEN : ORDERNM_SINGULAR;
}

/* Records the entries with undefined rates. */
int ordernm_not_finite(ordernm_motion *m, const scalar *rate)
{
    for (int i = 0; i < ordernm_counted(m); ++i)
        if (rate[i]*0.0 != 0.0) m->results->component = i;
    return ORDERNM_NOT_FINITE;
}

/* Whether functions in long double are needed that have not been compiled yet; returns true only once. */
int ordernm_wants_precise(ordernm_motion *m)
{
    const int wanted = m->imprecise && !m->system->precise && !m->results->as_is;
    m->imprecise = 0;
    return wanted;
}

static void keep_row(ordernm_results *r, const scalar *row, long size)
{
    memcpy(r->rows + r->count*size, row, size*sizeof(scalar));
    ++r->count;
}

/* Stores results at a state. Returns the reason for the motion's end if this fails. At a pose, uses the interpolated row. */
int ordernm_keep(ordernm_motion *m, scalar t, const scalar *z)
{
    const int known = m->row_known && m->known_row[0] == t;
    const int status = known ? 0 : ordernm_report(m, t, z, m->row);
    if (ordernm_wants_precise(m)) return ORDERNM_IMPRECISE;
    if (status) return ordernm_failed(m->results, status);
    keep_row(m->results, known ? m->known_row : m->row, ordernm_row_size(m->problem));
    return ORDERNM_ENDED;
}

/* Stores results at times within the accepted step. If memory is short, the step is repeated later. */
int ordernm_sample(ordernm_motion *m, scalar end)
{
    const ordernm_problem *const p = m->problem;
    const scalar h = end - m->t;
    while (m->sampled < p->ntimes && p->times[m->sampled] <= end) {
        if (m->results->count == m->results->capacity) return ORDERNM_FULL;
        const scalar t = p->times[m->sampled];
        const scalar *z = m->next;
        if (t < end) {
            if (!m->complete) {
                const int status = m->method->complete(m, h);
                if (status) return ordernm_failed(m->results, status);
                m->complete = 1;
            }
            m->method->interpolate(m, h, (t - m->t)/h, m->trial);
            z = m->trial;
            /* predictions between the ends of a step are as accurate as at its ends */
        }
        int reason = ordernm_keep(m, t, z);
        if (reason == ORDERNM_IMPRECISE) return reason;
        if (m->nd && t < end && (reason != ORDERNM_ENDED || m->results->condition_here > m->hopeless)
            && !ordernm_beside_within(m, h, (t - m->t)/h, ordernm_row_size(p))) {
            if (reason == ORDERNM_ENDED) --m->results->count;
            keep_row(m->results, m->known_row, ordernm_row_size(p));
            reason = ORDERNM_ENDED;
        }
        if (reason != ORDERNM_ENDED) return reason;
        ++m->sampled;
    }
    return ORDERNM_ENDED;
}

void ordernm_keep_step(const ordernm_motion *m, scalar h)
{
    ordernm_results *const r = m->results;
    scalar *const row = r->steps + r->steps_count*ordernm_step_size(m->problem);
    row[0] = m->t;
    row[1] = h;
    row[4] = m->best;
    row[5] = m->root < 0 ? 0 : 1 + m->root;
    ordernm_keep_modes(m, row + ORDERNM_STEP_HEAD);
    memcpy(row + m->head, m->z, (m->ny + m->nx + m->nd)*sizeof(scalar));
    m->method->keep(m, row);
    ++r->steps_count;
}

int ordernm_row(ordernm_motion *m, ordernm_results *results, scalar *row)
{
    m->results = results;
    ordernm_find_next_segment(m);
    return ordernm_report(m, m->t, m->z, row);
}
