/* A large batch: several states at once by a function of NAME_states.c, which reads and writes the arrays in place. */
#ifndef ORDERNM_DIRECT_STATES_H
#define ORDERNM_DIRECT_STATES_H

#include "direct_call.h"

#include <math.h>

/* NAME_states of the package's header; the workspace follows the last array. */
typedef struct {
    void *at;
    long state, direction, entry;
} strided;

typedef struct {
    long count, directions, failed;
    int code, infinite, *codes;
    strided arrays[MOST_ARRAYS + 1];
} batch;

typedef int (*over_states)(batch *);
typedef int (*on_threads)(over_states, batch *, int);

/* How a batch is computed: the function, the number of threads, and for several threads the function of NAME_threads.c. */
typedef struct {
    over_states run;
    on_threads share;
    int threads;
} way;

/* Lets the run time choose how to compute the batch; `run` is NULL for one state after another. Returns 1; 0 if the batch must take the
 * general path; -1 after an exception. */
static int ask_way(const Call *c, long states, long k, way *w)
{
    unsigned long long run, share;
    if (!c->large) return 0;
    PyObject *const found = PyObject_CallFunction(c->large, "ll", states, k);
    if (!found) return -1;
    const int known = found == Py_None ? 0 : PyArg_ParseTuple(found, "iKK", &w->threads, &run, &share) ? 1 : -1;
    Py_DECREF(found);
    if (known <= 0) return known;
    w->run = (over_states)(uintptr_t)run;
    w->share = (on_threads)(uintptr_t)share;
    return 1;
}

/* Strides of an array between states and between directions; 0 if it cannot be read in place. */
static int lay(const Call *c, const taken *a, PyObject *x, long states, int along, strided *s)
{
    PyArrayObject *const array = (PyArrayObject *)x;
    if (!is_plain(c, x) || !PyArray_ISCARRAY_RO(array)) return 0;
    const int entries = a->needed >= 0, nd = PyArray_NDIM(array), axes = nd + !entries;
    const int several = axes == 2 + along;
    if (axes < 1 || axes > 2 + along || (entries && PyArray_DIM(array, nd - 1) != a->size)) return 0;
    if (along && several && PyArray_DIM(array, 1) != states) return 0;
    const long direction = axes == 1 || !along ? 0 : several ? states*a->size : a->size;
    *s = (strided){PyArray_DATA(array), several ? a->size : 0, direction, 1};
    return 1;
}

/* Sets up arguments, seeds and results. `t` is memory for one number. */
static int lay_all(const Call *c, PyObject *given, PyObject *seeds, PyObject *arrays, long states, long k, char *t, batch *b)
{
    for (long i = 0; i < c->ntaken; ++i) {
        const taken *const a = c->takes + i;
        PyObject *const x = PyTuple_GET_ITEM(given, i);
        strided *const s = a->array < 0 ? NULL : b->arrays + a->array;
        double time;
        if (i == TIME) {
            if (!number(x, &time) || !isfinite(c->item == sizeof time ? time : (double)(float)time)) return 0;
            store(c, t, time);
            if (s) *s = (strided){t, 0, 0, 1};
        } else if (x == Py_None) {
            if (a->needed) return 0;
            if (s) *s = (strided){(void *)a->rest, 0, 0, 1};
        } else if (!s || !lay(c, a, x, states, 0, s)) {
            return 0;
        }
    }
    for (long i = 0; i < c->nseeds; ++i) {
        const taken *const a = c->seeds + i;
        PyObject *const x = PyTuple_GET_ITEM(seeds, i);
        if (x != Py_None && (a->array < 0 || !lay(c, a, x, states, 1, b->arrays + a->array))) return 0;
    }
    for (long i = 0; i < c->nresults; ++i) {
        const result *const r = c->results + i;
        if (r->array < 0) return 0;
        if (r->place < 0) continue; /* not returned, and not written */
        void *const to = PyArray_DATA((PyArrayObject *)PyTuple_GET_ITEM(arrays, r->place));
        b->arrays[r->array] = (strided){to, r->size, states*r->size, 1};
    }
    for (long i = 0; i < c->nreturned; ++i) {
        PyArrayObject *const to = (PyArrayObject *)PyTuple_GET_ITEM(arrays, i);
        if (c->returns[i].zeros) memset(PyArray_DATA(to), 0, PyArray_NBYTES(to));
    }
    b->count = states;
    b->directions = k;
    return 1;
}

/* Whether all quaternions of q are long enough. */
static int long_enough(const Call *c, const strided *q, long states)
{
    for (Py_ssize_t n = 0; n < PyTuple_GET_SIZE(c->quaternions); ++n) {
        const long first = PyLong_AsLong(PyTuple_GET_ITEM(c->quaternions, n));
        for (long i = 0; i < (q->state ? states : 1); ++i) {
            double square = 0.0;
            for (long j = i*q->state + first, end = j + 4; j < end; ++j) {
                const double e = c->item == sizeof e ? ((const double *)q->at)[j] : ((const float *)q->at)[j];
                square += e*e;
            }
            if (!(square >= c->least)) return 0;
        }
    }
    return 1;
}

/* Computes a batch into arrays; 0 if impossible, if a number is not finite, a quaternion is too short or a state is singular. */
static int compute_states(const Call *c, const way *w, PyObject *given, PyObject *seeds, PyObject *arrays, long states, long k)
{
    double t = 0.0;
    batch b;
    memset(&b, 0, sizeof b);
    if (!lay_all(c, given, seeds, arrays, states, k, (char *)&t, &b)) return 0;
    if (!long_enough(c, b.arrays + c->takes[0].array, states)) return 0;
    block *const memory = take_block(c->memory, w->threads*c->work_of_states*c->item);
    if (!memory) return 0;
    *(void **)(b.arrays + c->narrays) = (char *)memory + 64;
    int code;
    Py_BEGIN_ALLOW_THREADS
    code = w->threads > 1 ? w->share(w->run, &b, w->threads) : w->run(&b);
    Py_END_ALLOW_THREADS
    give_block(c, memory);
    return !code && !b.infinite;
}

#endif
