/* handler.c: XLA's calls of the compiled functions of solvers. XLA passes buffers; `ordernm_jax_call` computes all states of a batch
 * with the function that a plan describes. Python makes the plans, adds them with `ordernm_jax_add` and never frees them. */
#include <math.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "xla/ffi/api/c_api.h"

enum { MOST_PLANS = 4096, MOST_ARRAYS = 96, MOST_SLOTS = 48, MOST_PLACES = 16, CHUNKS = 4 /* per thread */, EVEN = 8, CHECKED = 1 };

/* The struct NAME_states of a package; the workspace follows the last array. */
typedef struct {
    char *at;
    long state, direction, entry;
} strided;

typedef struct {
    long count, directions, failed;
    int code, infinite, *codes;
    strided arrays[MOST_ARRAYS + 1];
} batch;

/* An operand or result: its index in the table of pointers (-1: time, -2: not read), its entries, its index in `batch` (-1: none), whether
 * it has an axis of directions, and its index among XLA's buffers (-1: not returned). */
typedef struct {
    long slot, size, array, along, buffer;
} place;

typedef struct {
    int64_t id;
    int (*call)(char *const *, long, double, long);
    int (*over)(int (*)(char *const *, long, double, long), char **, const long (*)[2], long, long, const double *, long, long *, long);
    int (*states)(batch *); /* several states at once; null if there is no such function */
    long item, operands, results, arrays, slots, workspace, lanes, workspace_of_states;
    long work_slot, lanes_slot, steps_slot, results_slot, checked, nan, quaternions;
    place operand[MOST_PLACES], result[MOST_PLACES];
    char *blank[MOST_SLOTS + MOST_ARRAYS]; /* the table of pointers before a call; then defaults of arrays */
    const long *quaternion;  /* first entries of quaternions in q */
    const char *const *names;
    const char *const *errors; /* messages by status */
    const char *function;
} ordernm_plan;

static ordernm_plan *plans[MOST_PLANS];
static atomic_int known;

/* Adds a plan; the caller holds a lock. Returns 0 if there is no room. */
int ordernm_jax_add(ordernm_plan *p)
{
    const int n = atomic_load(&known);
    if (n == MOST_PLANS) return 0;
    plans[n] = p;
    atomic_store(&known, n + 1);
    return 1;
}

long ordernm_jax_size(void)
{
    return (long)sizeof(ordernm_plan);
}

/* One call by XLA. Threads of XLA's pool take chunks of states; so does the caller, which never waits for a thread that has not begun. */
typedef struct {
    const ordernm_plan *plan;
    char *operand[MOST_PLACES], *result[MOST_PLACES];
    long state[MOST_PLACES], direction[MOST_PLACES]; /* strides of operands, in numbers */
    long count, k, chunk;
    atomic_long untaken, working, users, first; /* `first`: first bad state, or count */
    atomic_int code, memory;
} job;

enum { NO_NUMBER = -1, TOO_SHORT = -2 };

static double entry(const job *j, const char *at, long i)
{
    return j->plan->item == 8 ? ((const double *)at)[i] : ((const float *)at)[i];
}

/* Whether a quaternion of a state is too short, or not finite; q is the first operand. */
static int too_short(const job *j, long state)
{
    const ordernm_plan *const p = j->plan;
    for (long n = 0; n < p->quaternions; ++n) {
        double square = 0;
        for (long e = 0; e < 4; ++e) {
            const double x = entry(j, j->operand[0], state*j->state[0] + p->quaternion[n] + e);
            square += x*x;
        }
        if (!(square >= 1e-12)) return 1;
    }
    return 0;
}

/* Whether entries of a state are finite and its quaternions long enough: 0, NO_NUMBER or TOO_SHORT. */
static int unfit(const job *j, long state, long *operand)
{
    const ordernm_plan *const p = j->plan;
    for (long i = 0; i < p->operands; ++i) {
        const place *const a = p->operand + i;
        *operand = i;
        for (long d = 0; d < (a->along ? j->k : 1); ++d)
            for (long e = 0; e < a->size; ++e)
                if (!isfinite(entry(j, j->operand[i], state*j->state[i] + d*j->direction[i] + e))) return NO_NUMBER;
    }
    return too_short(j, state) ? TOO_SHORT : 0;
}

/* Whether all numbers of states from `begin` to `end` - 1 are finite and all quaternions long enough. */
static int all_fit(const job *j, long begin, long end)
{
    const ordernm_plan *const p = j->plan;
    double sum = 0;
    for (long i = 0; i < p->operands; ++i) {
        const place *const a = p->operand + i;
        const long last = j->state[i] ? end : begin + 1;
        for (long d = 0; d < (a->along ? j->k : 1); ++d) {
            const long from = begin*j->state[i] + d*j->direction[i], n = (last - begin)*a->size;
            double s[4] = {0, 0, 0, 0};
            if (p->item == 8) {
                const double *const x = (const double *)j->operand[i] + from;
                long e = 0;
                for (; e + 4 <= n; e += 4)
                    for (int l = 0; l < 4; ++l) s[l] += 0*x[e + l];
                for (; e < n; ++e) s[0] += 0*x[e];
            } else {
                const float *const x = (const float *)j->operand[i] + from;
                for (long e = 0; e < n; ++e) s[0] += 0*x[e];
            }
            sum += s[0] + s[1] + s[2] + s[3];
        }
    }
    for (long state = begin; p->quaternions && sum == 0 && state < end; ++state)
        if (too_short(j, state)) return 0;
    return sum == 0;
}

/* Sets the results of a state to NaN. */
static void spoil(const job *j, long state)
{
    const ordernm_plan *const p = j->plan;
    for (long i = 0; i < p->results; ++i) {
        const place *const r = p->result + i;
        if (r->buffer < 0) continue;
        for (long d = 0; d < (r->along ? j->k : 1); ++d)
            for (long e = 0; e < r->size; ++e) {
                const long at = (d*j->count + state)*r->size + e;
                if (p->item == 8) ((double *)j->result[i])[at] = NAN;
                else ((float *)j->result[i])[at] = NAN;
            }
    }
}

/* Notes a bad state: writes NaN to its results, or keeps the first bad state for an error. */
static void note(job *j, long state, int code)
{
    if (j->plan->nan) {
        spoil(j, state);
        return;
    }
    long first = atomic_load(&j->first);
    while (state < first)
        if (atomic_compare_exchange_weak(&j->first, &first, state)) {
            atomic_store(&j->code, code);
            return;
        }
}

/* Computes states one after another. */
static void one_by_one(job *j, char *memory, long begin, long end)
{
    const ordernm_plan *const p = j->plan;
    char *x[MOST_SLOTS];
    long moves[2*MOST_PLACES][2], steps[MOST_SLOTS] = {0}, count = 0, given = p->checked;
    const double *times = 0;
    double time[1], *own = 0;
    memcpy(x, p->blank, sizeof x);
    x[p->work_slot] = memory;
    x[p->lanes_slot] = memory + p->workspace*p->item;
    x[p->steps_slot] = (char *)steps;
    char *unused = memory + (p->workspace + p->lanes)*p->item;
    for (long i = 0; i < p->operands; ++i) {
        const place *const a = p->operand + i;
        char *const at = j->operand[i] + begin*j->state[i]*p->item;
        if (a->slot == -1) {
            if (j->state[i] && p->item == 8) {
                times = (const double *)j->operand[i];
            } else {
                own = time;
                *time = entry(j, at, 0);
            }
        }
        if (a->slot < 0) continue;
        given |= 1L << a->slot;
        x[a->slot] = at;
        steps[a->slot] = j->direction[i];
        if (j->state[i]) moves[count][0] = a->slot, moves[count++][1] = j->state[i]*p->item;
    }
    for (long i = 0; i < p->results; ++i) {
        const place *const r = p->result + i;
        const long slot = p->results_slot + i;
        steps[slot] = r->along ? j->count*r->size : 0;
        x[slot] = r->buffer < 0 ? unused : j->result[i] + begin*r->size*p->item;
        if (r->buffer < 0) unused += r->size*p->item;
        else moves[count][0] = slot, moves[count++][1] = r->size*p->item;
    }
    for (long n = begin; n < end;) {
        const long from = n;
        int code;
        if (own || (j->count > 1 && p->item != 8)) { /* one time for all states, or times in single precision */
            for (long i = 0; i < p->operands; ++i)
                if (p->operand[i].slot == -1 && j->state[i]) *time = entry(j, j->operand[i], n);
            code = p->call(x, given, *time, j->k);
            for (long i = 0; i < count; ++i) x[moves[i][0]] += moves[i][1];
            ++n;
        } else {
            long in_numbers[2*MOST_PLACES][2];
            for (long i = 0; i < count; ++i) in_numbers[i][0] = moves[i][0], in_numbers[i][1] = moves[i][1]/p->item;
            code = p->over(p->call, x, (const long (*)[2])in_numbers, count, given, times, j->k, &n, end);
        }
        if (code) note(j, n - 1, code);
        if (code && !p->nan) return;
        if (n == from) return;
    }
}

/* Computes several states at once; returns whether all are good. */
static int together(job *j, char *memory, long begin, long end)
{
    const ordernm_plan *const p = j->plan;
    batch b;
    memset(&b, 0, sizeof b);
    b.count = end - begin;
    b.directions = j->k;
    char *unused = memory + p->workspace_of_states*p->item;
    for (long i = 0; i < p->operands; ++i) {
        const place *const a = p->operand + i;
        if (a->array >= 0)
            b.arrays[a->array] = (strided){j->operand[i] + begin*j->state[i]*p->item, j->state[i], j->direction[i], 1};
    }
    for (long i = 0; i < p->results; ++i) {
        const place *const r = p->result + i;
        if (r->buffer < 0) b.arrays[r->array] = (strided){unused, 0, 0, 1}, unused += r->size*p->item;
        else b.arrays[r->array] = (strided){j->result[i] + begin*r->size*p->item, r->size, j->count*r->size, 1};
    }
    for (long i = 0; i < p->arrays; ++i) /* missing arguments have their defaults; missing seeds are zero */
        if (!b.arrays[i].at) b.arrays[i] = (strided){p->blank[p->slots + i], 0, 0, 1};
    *(char **)(b.arrays + p->arrays) = memory;
    return !p->states(&b) && !b.infinite;
}

static void compute(job *j, char *memory, long begin, long end)
{
    const ordernm_plan *const p = j->plan;
    if (p->states && end - begin >= EVEN && !p->quaternions) {
        if (together(j, memory, begin, end)) return;
    } else if (all_fit(j, begin, end)) {
        if (!p->states || end - begin < EVEN) {
            one_by_one(j, memory, begin, end);
            return;
        }
        if (together(j, memory, begin, end)) return;
    }
    for (long n = begin; n < end; ++n) { /* find the bad states */
        long operand;
        const int code = unfit(j, n, &operand);
        if (code) note(j, n, code);
        else one_by_one(j, memory, n, n + 1);
    }
}

static void leave(job *j)
{
    if (atomic_fetch_sub(&j->users, 1) == 1) free(j);
}

static void take_chunks(job *j)
{
    const ordernm_plan *const p = j->plan;
    long numbers = p->workspace + p->lanes > p->workspace_of_states ? p->workspace + p->lanes : p->workspace_of_states;
    for (long i = 0; i < p->results; ++i) numbers += p->result[i].size*(p->result[i].along ? j->k : 1);
    char *memory = 0;
    for (;;) {
        atomic_fetch_add(&j->working, 1);
        const long begin = atomic_fetch_add(&j->untaken, j->chunk);
        if (begin < j->count) {
            if (!memory) memory = aligned_alloc(64, ((size_t)numbers*p->item/64 + 2)*64);
            if (memory) compute(j, memory, begin, begin + j->chunk < j->count ? begin + j->chunk : j->count);
            else atomic_store(&j->memory, 1);
        }
        atomic_fetch_sub(&j->working, 1);
        if (begin >= j->count) break;
    }
    free(memory);
}

static void help(void *data)
{
    take_chunks(data);
    leave(data);
}

static XLA_FFI_Error *error(const XLA_FFI_Api *api, XLA_FFI_Error_Code code, const char *message)
{
    XLA_FFI_Error_Create_Args args = {XLA_FFI_Error_Create_Args_STRUCT_SIZE, 0, message, code};
    return api->XLA_FFI_Error_Create(&args);
}

/* The error for the first bad state of a job. */
static XLA_FFI_Error *bad_state(const XLA_FFI_Api *api, job *j)
{
    const ordernm_plan *const p = j->plan;
    const long state = atomic_load(&j->first);
    const int code = atomic_load(&j->code);
    char where[64] = "", text[1024];
    if (j->count > 1) snprintf(where, sizeof where, " (state %ld of the batch of %ld)", state, j->count);
    long operand = 0;
    if (code == NO_NUMBER) {
        unfit(j, state, &operand);
        snprintf(text, sizeof text, "%s: %s has an entry that is not finite%s", p->function, p->names[operand], where);
    } else if (code == TOO_SHORT) {
        snprintf(text, sizeof text, "%s: a quaternion of q is shorter than 1e-06%s; no rotation is (1, 0, 0, 0)", p->function, where);
    } else {
        snprintf(text, sizeof text, "%s: %s%s", p->function, code > 0 ? p->errors[code - 1] : "its library is not open", where);
    }
    return error(api, XLA_FFI_Error_Code_FAILED_PRECONDITION, text);
}

static int64_t attribute(const XLA_FFI_CallFrame *f, const char *name)
{
    for (int64_t i = 0; i < f->attrs.size; ++i) {
        const XLA_FFI_ByteSpan *const n = f->attrs.names[i];
        if (n->len == strlen(name) && !memcmp(n->ptr, name, n->len) && f->attrs.types[i] == XLA_FFI_AttrType_SCALAR)
            return *(const int64_t *)((const XLA_FFI_Scalar *)f->attrs.attrs[i])->value;
    }
    return -1;
}

/* Fills in the buffers of a job; returns 0 if they are not those of the plan. */
static int take_buffers(job *j, const XLA_FFI_CallFrame *f)
{
    const ordernm_plan *const p = j->plan;
    long returned = 0;
    for (long i = 0; i < p->results; ++i) returned += p->result[i].buffer >= 0;
    if (f->args.size != p->operands || f->rets.size != returned) return 0;
    const XLA_FFI_DataType type = p->item == 8 ? XLA_FFI_DataType_F64 : XLA_FFI_DataType_F32;
    for (long i = 0; i < p->operands; ++i) {
        const XLA_FFI_Buffer *const b = f->args.args[i];
        const place *const a = p->operand + i;
        if (b->dtype != type || b->rank < 1 + a->along || b->dims[b->rank - 1] != a->size) return 0;
        long numbers = 1;
        for (int64_t d = 0; d < b->rank; ++d) numbers *= b->dims[d];
        const int whole = b->rank > 1 + a->along;
        if (numbers != (whole ? j->count : 1)*(a->along ? j->k : 1)*a->size) return 0;
        j->operand[i] = b->data;
        j->state[i] = whole ? a->size : 0;
        j->direction[i] = !a->along ? 0 : whole ? j->count*a->size : a->size;
    }
    for (long i = 0; i < p->results; ++i) {
        const place *const r = p->result + i;
        if (r->buffer < 0) continue;
        const XLA_FFI_Buffer *const b = f->rets.rets[r->buffer];
        long numbers = 1;
        for (int64_t d = 0; d < b->rank; ++d) numbers *= b->dims[d];
        if (b->dtype != type || numbers != j->count*(r->along ? j->k : 1)*r->size) return 0;
        j->result[i] = b->data;
    }
    return 1;
}

static XLA_FFI_Error *run(XLA_FFI_CallFrame *f, const ordernm_plan *p)
{
    job *const j = calloc(1, sizeof *j);
    if (!j) return error(f->api, XLA_FFI_Error_Code_RESOURCE_EXHAUSTED, "ordernm: no memory");
    j->plan = p;
    j->count = attribute(f, "count");
    j->k = attribute(f, "k");
    long threads = attribute(f, "threads");
    if (!take_buffers(j, f)) {
        free(j);
        return error(f->api, XLA_FFI_Error_Code_INVALID_ARGUMENT, "ordernm: buffers do not have the shapes and types of the function");
    }
    atomic_store(&j->first, j->count);
    atomic_store(&j->users, 1);
    j->chunk = threads < 2 ? j->count : (j->count/(CHUNKS*threads) + EVEN - 1)/EVEN*EVEN;
    if (j->chunk < EVEN) j->chunk = EVEN;
    for (; threads > 1; --threads) {
        XLA_FFI_ThreadPool_Schedule_Args args = {XLA_FFI_ThreadPool_Schedule_Args_STRUCT_SIZE, 0, f->ctx, help, j};
        atomic_fetch_add(&j->users, 1);
        XLA_FFI_Error *const refused = f->api->XLA_FFI_ThreadPool_Schedule(&args);
        if (refused) { /* the caller computes alone */
            XLA_FFI_Error_Destroy_Args end = {XLA_FFI_Error_Destroy_Args_STRUCT_SIZE, 0, refused};
            f->api->XLA_FFI_Error_Destroy(&end);
            leave(j);
            break;
        }
    }
    take_chunks(j);
    while (atomic_load(&j->working)) sched_yield(); /* at most one chunk of each thread that has begun */
    XLA_FFI_Error *found = 0;
    if (atomic_load(&j->memory)) found = error(f->api, XLA_FFI_Error_Code_RESOURCE_EXHAUSTED, "ordernm: no memory for a workspace");
    else if (atomic_load(&j->first) < j->count) found = bad_state(f->api, j);
    leave(j);
    return found;
}

XLA_FFI_Error *ordernm_jax_call(XLA_FFI_CallFrame *f)
{
    for (XLA_FFI_Extension_Base *e = f->extension_start; e; e = e->next)
        if (e->type == XLA_FFI_Extension_Metadata) { /* XLA asks for the version at registration */
            XLA_FFI_Metadata *const m = ((XLA_FFI_Metadata_Extension *)e)->metadata;
            m->api_version.major_version = XLA_FFI_API_MAJOR;
            m->api_version.minor_version = XLA_FFI_API_MINOR;
            m->traits = 0;
            return 0;
        }
    if (f->stage != XLA_FFI_ExecutionStage_EXECUTE) return 0;
    const int64_t id = attribute(f, "plan");
    for (int i = 0, n = atomic_load(&known); i < n; ++i)
        if (plans[i]->id == id) return run(f, plans[i]);
    return error(f->api, XLA_FFI_Error_Code_NOT_FOUND,
        "ordernm: this program belongs to a solver that is not loaded in this process; call ordernm.jax.function first");
}
