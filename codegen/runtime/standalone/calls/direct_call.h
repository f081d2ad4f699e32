/* A call of direct_call.c, and its conversion of arguments and seeds. */
#ifndef ORDERNM_DIRECT_CALL_H
#define ORDERNM_DIRECT_CALL_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#define NPY_NO_DEPRECATED_API NPY_1_7_API_VERSION
#include <numpy/arrayobject.h>

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_TAKEN = 16, MOST_RESULTS = 16, MOST_ARRAYS = 32, MOST_POINTERS = 48, MOST_AXES = 3, TIME = 4, KEPT = 1 << 19, KEPT_OF_STATES = 1 << 23 };

/* Reusable memory of calls; the interpreter's lock protects the list. */
typedef struct block {
    struct block *next;
    size_t size;
} block;

typedef struct {
    block *free;
} pool;

static const char POOL[] = "ordernm_call.pool";

static void free_pool(PyObject *capsule)
{
    pool *p = PyCapsule_GetPointer(capsule, POOL);
    while (p->free) {
        block *b = p->free;
        p->free = b->next;
        free(b);
    }
    PyMem_Free(p);
}

static PyObject *new_pool(PyObject *Py_UNUSED(module), PyObject *Py_UNUSED(none))
{
    pool *p = PyMem_Calloc(1, sizeof *p);
    if (!p) return PyErr_NoMemory();
    return PyCapsule_New(p, POOL, free_pool);
}

static block *take_block(pool *p, size_t size)
{
    block *b = p->free;
    if (b) p->free = b->next;
    if (b && b->size >= size) return b;
    free(b);
    b = aligned_alloc(64, 64 + (size + 63)/64*64);
    if (b) b->size = size;
    return b;
}

/* An argument or a seed. */
typedef struct {
    long slot, size, needed; /* `needed` is -1 for dt, which has no axis of entries */
    PyObject *names;         /* indices of entries by name, or NULL */
    const char *rest;        /* values of entries that a mapping leaves out; NULL for zeros */
    long array;              /* index of the argument in NAME_states, or -1 */
} taken;

/* A result of the C function: its number of entries, whether it has one row per direction, and its index among the returned results; -1
 * if it is not returned, -2 if it is not computed. */
typedef struct {
    long size, derived, place, array;
} result;

/* A returned result: its shape after the axes of directions and states; zeros are not computed. */
typedef struct {
    int derived, zeros, nd;
    npy_intp shape[MOST_AXES], size;
} returned;

typedef int (*function)(void *const *, long, double, long);

typedef struct {
    PyObject_HEAD
    vectorcallfunc call;
    function run;
    pool *memory;
    PyObject *kept;
    int type;
    size_t item;
    long needed, work, lanes, few, few_along, at_work, at_lanes, at_results;
    long ntaken, nseeds, nresults, nreturned;
    PyObject *large; /* decides the way in which a large batch is computed; NULL if never several states at once */
    long narrays, work_of_states;
    PyObject *quaternions; /* index in q of the first component of each quaternion, as a tuple */
    double least; /* the least square of a quaternion's norm */
    void *pointers[MOST_POINTERS];
    taken takes[MOST_TAKEN], seeds[MOST_TAKEN];
    result results[MOST_RESULTS];
    returned returns[MOST_RESULTS];
} Call;

static void give_block(const Call *c, block *b)
{
    if (b->size > c->work*c->item + (c->large ? KEPT_OF_STATES : KEPT)) {
        free(b);
        return;
    }
    b->next = c->memory->free;
    c->memory->free = b;
}

static int is_plain(const Call *c, PyObject *x)
{
    return PyArray_CheckExact(x) && PyArray_TYPE((PyArrayObject *)x) == c->type && PyArray_ISNOTSWAPPED((PyArrayObject *)x);
}

static int number(PyObject *x, double *value)
{
    if (PyFloat_Check(x)) *value = PyFloat_AS_DOUBLE(x);
    else if (PyLong_CheckExact(x)) *value = PyLong_AsDouble(x);
    else return 0;
    if (*value != -1.0 || !PyErr_Occurred()) return 1;
    PyErr_Clear(); /* an integer too large for a double */
    return 0;
}

static void store(const Call *c, char *to, double value)
{
    if (c->item == sizeof value) {
        memcpy(to, &value, sizeof value);
    } else {
        const float rounded = (float)value;
        memcpy(to, &rounded, sizeof rounded);
    }
}

static int take_names(const Call *c, const taken *a, PyObject *x, char *to)
{
    PyObject *key, *value;
    Py_ssize_t i = 0;
    double entry;
    if (!a->names) return 0;
    if (a->rest) memcpy(to, a->rest, a->size*c->item);
    else memset(to, 0, a->size*c->item);
    while (PyDict_Next(x, &i, &key, &value)) {
        PyObject *const place = PyUnicode_CheckExact(key) ? PyDict_GetItem(a->names, key) : NULL;
        if (!place || !number(value, &entry)) return 0;
        store(c, to + PyLong_AsLong(place)*c->item, entry);
    }
    return 1;
}

static int take_list(const Call *c, const taken *a, PyObject *x, char *to)
{
    double entry;
    if (Py_SIZE(x) != a->size) return 0;
    for (long i = 0; i < a->size; ++i) {
        if (!number(PyList_CheckExact(x) ? PyList_GET_ITEM(x, i) : PyTuple_GET_ITEM(x, i), &entry)) return 0;
        store(c, to + i*c->item, entry);
    }
    return 1;
}

static void take_row(const Call *c, const char *from, npy_intp step, long n, char *to)
{
    if (step == (npy_intp)c->item || n < 2) {
        memcpy(to, from, n*c->item);
        return;
    }
    for (long i = 0; i < n; ++i) memcpy(to + i*c->item, from + i*step, c->item);
}

/* An argument, as [rows][size]: one row for all states, or one for each. Returns the number of rows; 0 if it is not plain. */
static long take(const Call *c, const taken *a, PyObject *x, long states, char *to)
{
    if (!PyArray_CheckExact(x)) {
        if (PyDict_CheckExact(x)) return take_names(c, a, x, to);
        return (PyList_CheckExact(x) || PyTuple_CheckExact(x)) && take_list(c, a, x, to);
    }
    PyArrayObject *const array = (PyArrayObject *)x;
    const npy_intp *const shape = PyArray_DIMS(array), *const steps = PyArray_STRIDES(array);
    const int nd = PyArray_NDIM(array);
    if (!is_plain(c, x) || nd < 1 || nd > 2 || shape[nd - 1] != a->size || (nd == 2 && shape[0] != states)) return 0;
    const long rows = nd == 2 ? states : 1;
    for (long i = 0; i < rows; ++i)
        take_row(c, PyArray_BYTES(array) + (nd == 2 ? i*steps[0] : 0), steps[nd - 1], a->size, to + i*a->size*c->item);
    return rows;
}

/* A seed, as [states][k][size], or [k][size] for all states. */
static long take_seed(const Call *c, const taken *a, PyObject *x, long k, long states, char *to)
{
    double value;
    if (!PyArray_CheckExact(x)) {
        if (k != 1) return 0;
        if (PyDict_CheckExact(x)) return take_names(c, a, x, to);
        if (PyList_CheckExact(x) || PyTuple_CheckExact(x)) return a->needed >= 0 && take_list(c, a, x, to);
        if (a->needed >= 0 || !number(x, &value)) return 0;
        store(c, to, value);
        return 1;
    }
    PyArrayObject *const array = (PyArrayObject *)x;
    const npy_intp *const shape = PyArray_DIMS(array), *const steps = PyArray_STRIDES(array);
    const int entries = a->needed >= 0, nd = PyArray_NDIM(array), lone = entries && nd == 1, several = nd == 2 + entries;
    if (!is_plain(c, x) || nd < 1 || nd > 2 + entries || (entries && shape[nd - 1] != a->size)) return 0;
    if (several && (!states || (shape[1] != 1 && shape[1] != states))) return 0;
    const long rows = several && shape[1] > 1 ? states : 1;
    for (long i = 0; i < rows; ++i)
        for (long j = 0; j < k; ++j)
            take_row(c, PyArray_BYTES(array) + (lone ? 0 : j*steps[0]) + (rows > 1 ? i*steps[1] : 0), entries ? steps[nd - 1] : 0,
                a->size, to + (i*k + j)*a->size*c->item);
    return rows;
}

/* Numbers of states and directions; 0 states for a single state without an axis. */
static int count(const Call *c, PyObject *given, PyObject *seeds, long *states, long *k)
{
    *states = *k = 0;
    for (long i = 0; i < c->ntaken; ++i) {
        PyObject *const x = PyTuple_GET_ITEM(given, i);
        if (!PyArray_CheckExact(x) || PyArray_NDIM((PyArrayObject *)x) != 2 - (i == TIME)) continue;
        const long n = (long)PyArray_DIM((PyArrayObject *)x, 0);
        if (n < 1 || (*states && *states != n)) return 0;
        *states = n;
    }
    if (!c->nseeds) return 1;
    for (long i = 0; i < c->nseeds; ++i) {
        PyObject *const x = PyTuple_GET_ITEM(seeds, i);
        if (x == Py_None) continue;
        long n = 1;
        if (PyArray_CheckExact(x) && PyArray_NDIM((PyArrayObject *)x) > (c->seeds[i].needed >= 0))
            n = (long)PyArray_DIM((PyArrayObject *)x, 0);
        if (n < 1 || (*k && *k != n)) return 0;
        *k = n;
    }
    return *k > 0;
}

/* Times of several states. */
static int take_times(const Call *c, PyObject *x, long n, double *t)
{
    if (!is_plain(c, x) || PyArray_NDIM((PyArrayObject *)x) != 1) return 0;
    for (long i = 0; i < n; ++i) {
        const char *const at = PyArray_BYTES((PyArrayObject *)x) + i*PyArray_STRIDE((PyArrayObject *)x, 0);
        float single;
        if (c->type == NPY_DOUBLE) {
            memcpy(t + i, at, sizeof *t);
        } else {
            memcpy(&single, at, sizeof single);
            t[i] = single;
        }
    }
    return 1;
}

#endif
