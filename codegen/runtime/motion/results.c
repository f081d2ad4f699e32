/* What is kept of a motion: rows of results at times within a step, steps for the way back, and why no more comes. */
#include "inside.h"

#include <math.h>
#include <string.h>

/* Why rates could not be computed. */
int ordernm_failed(ordernm_results *r, int status)
{
    if (status == SLIDES) return ORDERNM_SLIDING;
    r->singular = status;
    return status < 0 ? ORDERNM_OPEN : ORDERNM_SINGULAR;
}

/* Rates of these entries have no value. */
int ordernm_not_finite(ordernm_motion *m, const scalar *rate)
{
    for (int i = 0; i < ordernm_counted(m); ++i)
        if (rate[i]*0.0 != 0.0) m->results->component = i;
    return ORDERNM_NOT_FINITE;
}

/* Whether something was to be computed in long double that has not been compiled yet; it is once. */
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

/* Results at a state; the reason where there are none. Those at a pose that a step ends at are known. */
int ordernm_keep(ordernm_motion *m, scalar t, const scalar *z)
{
    const int known = m->row_known && m->known_row[0] == t;
    const int status = known ? 0 : ordernm_report(m, t, z, m->row);
    if (ordernm_wants_precise(m)) return ORDERNM_IMPRECISE;
    if (status) return ordernm_failed(m->results, status);
    keep_row(m->results, known ? m->known_row : m->row, ordernm_row_size(m->problem));
    return ORDERNM_ENDED;
}

/* Results at the times within the step that has been made. Without room for them the step is made again. */
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
            /* predictions between the ends of a step are as good as at its ends */
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
    ordernm_find_segment(m, m->t, 1e-9*(1.0 + fabs(m->t)));
    return ordernm_report(m, m->t, m->z, row);
}
