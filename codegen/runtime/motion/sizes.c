/* Lengths of a motion's rows: results, events, stored steps. */
#include "inside.h"

/* The method of a motion. If nothing is independent, an implicit method has no equations, and an explicit one is used. */
int ordernm_kind(const ordernm_problem *p)
{
    const int solves = p->system->nfree_q + p->system->nfree_u > 0;
    return p->method == ORDERNM_RADAU && !solves ? ORDERNM_DOP853 : p->method;
}

long ordernm_row_size(const ordernm_problem *p)
{
    const ordernm_system *s = p->system;
    const long n = s->nq + s->nu + s->noutputs + p->nintegrals;
    return 1 + n*(1 + p->ndirections);
}

long ordernm_event_size(const ordernm_problem *p)
{
    const ordernm_system *const s = p->system;
    return ordernm_row_size(p) + s->nq + s->nu + s->noutputs + p->ndirections + 1;
}

long ordernm_head_size(const ordernm_problem *p) { return ORDERNM_STEP_HEAD + 2*p->system->nswitches; }

long ordernm_step_size(const ordernm_problem *p)
{
    const ordernm_system *s = p->system;
    const int kind = ordernm_kind(p), stages = kind == ORDERNM_RK4 ? RK4_STAGES : kind == ORDERNM_DOP853 ? DOP853_STAGES : RADAU_STAGES;
    const long state = s->nq + s->nfree_u + p->nintegrals;
    /* stages other than the start; for explicit methods also coordinates with closed loops, and the first rate */
    const long of_stages = kind == ORDERNM_RADAU ? stages*state : (stages - 1)*(state + (s->closing_step ? s->nq : 0)) + state;
    return ordernm_head_size(p) + state + of_stages;
}

long ordernm_known_size(const ordernm_problem *p)
{
    const ordernm_system *s = p->system;
    return ordernm_kind(p) == ORDERNM_RADAU ? 4 + 4*ordernm_whole_lines(s->nq + s->nfree_u + p->nintegrals) : 0;
}
