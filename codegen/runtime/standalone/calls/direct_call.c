/* Calls the functions of NAME_calls.c from Python with a user's arguments: one state, or a few states along one axis, in NumPy
 * arrays, lists or numbers by name. Compiled once per Python and NumPy version.
 *
 * A call copies arguments and seeds into its own memory, so that results may overwrite them. It releases the interpreter's lock
 * while it computes, and returns a tuple of arrays. It returns None, without an exception, for everything else: other types or
 * shapes, numbers that are not finite, singular states. Then the general path in Python converts the arguments, or raises. */
#include "direct_call.h"
#include "direct_states.h"

/* The memory range of an array. */
static void extent(PyArrayObject *x, const char **begin, const char **end)
{
    *begin = *end = PyArray_BYTES(x);
    if (!PyArray_SIZE(x)) return;
    for (int i = 0; i < PyArray_NDIM(x); ++i) {
        const npy_intp reach = (PyArray_DIM(x, i) - 1)*PyArray_STRIDE(x, i);
        *(reach < 0 ? begin : end) += reach;
    }
    *end += PyArray_ITEMSIZE(x);
}

static int overlap(PyObject *a, PyObject *b)
{
    const char *from, *to, *from_b, *to_b;
    if (!PyArray_Check(a) || !PyArray_Check(b)) return 0;
    extent((PyArrayObject *)a, &from, &to);
    extent((PyArrayObject *)b, &from_b, &to_b);
    return from < to_b && from_b < to;
}

static int shape_of(const returned *r, long states, long k, npy_intp *shape)
{
    int nd = 0;
    if (r->derived) shape[nd++] = k;
    if (states) shape[nd++] = states;
    for (int i = 0; i < r->nd; ++i) shape[nd++] = r->shape[i];
    return nd;
}

/* The caller's arrays as a tuple (a new reference); NULL if results cannot be written to them. */
static PyObject *places(const Call *c, PyObject *out, long states, long k)
{
    const int alone = !c->nseeds && c->nreturned == 1;
    PyObject *const found = alone ? PyTuple_Pack(1, out) : PyList_CheckExact(out) ? PyList_AsTuple(out) : Py_NewRef(out);
    if (!found || !PyTuple_CheckExact(found) || PyTuple_GET_SIZE(found) != c->nreturned) goto refused;
    for (long i = 0; i < c->nreturned; ++i) {
        npy_intp shape[MOST_AXES + 2];
        const int nd = shape_of(c->returns + i, states, k, shape);
        PyArrayObject *const x = (PyArrayObject *)PyTuple_GET_ITEM(found, i);
        if (!is_plain(c, (PyObject *)x) || !PyArray_ISCARRAY(x) || PyArray_NDIM(x) != nd) goto refused;
        if (!PyArray_CompareLists(PyArray_DIMS(x), shape, nd)) goto refused;
        for (long j = 0; j < i; ++j)
            if (overlap(PyTuple_GET_ITEM(found, j), (PyObject *)x)) goto refused;
    }
    return found;
refused:
    Py_XDECREF(found);
    return NULL;
}

/* New arrays for results, as a tuple; NULL without memory. */
static PyObject *new_arrays(const Call *c, long states, long k)
{
    PyObject *const found = PyTuple_New(c->nreturned);
    for (long i = 0; found && i < c->nreturned; ++i) {
        npy_intp shape[MOST_AXES + 2];
        const int nd = shape_of(c->returns + i, states, k, shape);
        PyObject *const x = PyArray_SimpleNew(nd, shape, c->type);
        if (!x) {
            Py_DECREF(found);
            return NULL;
        }
        PyTuple_SET_ITEM(found, i, x);
    }
    return found;
}

static int overlaps_any(PyObject *arrays, PyObject *given)
{
    for (Py_ssize_t i = 0; i < PyTuple_GET_SIZE(arrays); ++i)
        for (Py_ssize_t j = 0; j < PyTuple_GET_SIZE(given); ++j)
            if (overlap(PyTuple_GET_ITEM(arrays, i), PyTuple_GET_ITEM(given, j))) return 1;
    return 0;
}

static void copy_arrays(PyObject *to, PyObject *from)
{
    for (Py_ssize_t i = 0; i < PyTuple_GET_SIZE(to); ++i) {
        PyArrayObject *const x = (PyArrayObject *)PyTuple_GET_ITEM(from, i);
        memcpy(PyArray_DATA((PyArrayObject *)PyTuple_GET_ITEM(to, i)), PyArray_DATA(x), PyArray_NBYTES(x));
    }
}

/* A pointer of the table and its stride between states. */
typedef struct {
    long at, step;
} moving;

/* A derivative of one of several states, [k][size], and the location of its rows in [k][states][size]. */
typedef struct {
    char *from, *to;
    long size;
} gathered;

typedef struct {
    void *x[MOST_POINTERS];
    moving moves[2*MOST_TAKEN + MOST_RESULTS];
    gathered rows[MOST_RESULTS];
    long nmoves, nrows, given;
    const double *t;
    int t_moves;
} job;

static int compute(const Call *c, job *j, long states, long k)
{
    int status = 0;
    for (long n = 0; n < (states ? states : 1) && !status; ++n) {
        status = c->run(j->x, j->given, j->t[j->t_moves ? n : 0], k);
        for (long i = 0; i < j->nrows && !status; ++i) {
            const gathered *const g = j->rows + i;
            for (long l = 0; l < k; ++l) memcpy(g->to + (l*states + n)*g->size, g->from + l*g->size, g->size);
        }
        for (long i = 0; i < j->nmoves; ++i) j->x[j->moves[i].at] = (char *)j->x[j->moves[i].at] + j->moves[i].step;
    }
    return status;
}

static void move(job *j, long at, long step)
{
    j->moves[j->nmoves++] = (moving){at, step};
}

/* Copies arguments and seeds to `at`; returns the end of the used memory, or NULL if they are not plain. */
static char *take_all(const Call *c, job *j, PyObject *given, PyObject *seeds, long states, long k, char *at)
{
    const long n = states ? states : 1;
    long needed = 0;
    double *const t = (double *)at;
    at += n*sizeof *t;
    for (long i = 0; i < c->ntaken; ++i) {
        PyObject *const x = PyTuple_GET_ITEM(given, i);
        const taken *const a = c->takes + i;
        if (i == TIME) {
            j->t = t;
            if (number(x, t)) continue;
            if (!states || !take_times(c, x, n, t)) return NULL;
            j->t_moves = 1;
            continue;
        }
        if (x == Py_None) continue;
        const long rows = take(c, a, x, states, at);
        if (!rows) return NULL;
        j->x[a->slot] = at;
        j->given |= 1L << a->slot;
        needed |= a->needed ? 1L << a->slot : 0;
        if (rows > 1) move(j, a->slot, a->size*c->item);
        at += rows*a->size*c->item;
    }
    if (needed != c->needed) return NULL;
    for (long i = 0; i < c->nseeds; ++i) {
        PyObject *const x = PyTuple_GET_ITEM(seeds, i);
        const taken *const a = c->seeds + i;
        if (x == Py_None) continue;
        const long rows = take_seed(c, a, x, k, states, at);
        if (!rows) return NULL;
        j->x[a->slot] = at;
        j->given |= 1L << a->slot;
        if (rows > 1) move(j, a->slot, k*a->size*c->item);
        at += rows*k*a->size*c->item;
    }
    return at;
}

/* Points results to arrays, or to memory at `at`. */
static void place_results(const Call *c, job *j, PyObject *arrays, long states, long k, char *at)
{
    for (long i = 0; i < c->nresults; ++i) {
        const result *const r = c->results + i;
        const long bytes = r->size*c->item, several = r->derived && states > 1;
        char *const to = r->place < 0 ? NULL : PyArray_BYTES((PyArrayObject *)PyTuple_GET_ITEM(arrays, r->place));
        j->x[c->at_results + i] = r->place == -2 ? NULL : to && !several ? to : at;
        if (to && several) j->rows[j->nrows++] = (gathered){at, to, bytes};
        if (to && !several && states > 1) move(j, c->at_results + i, bytes);
        if (r->place != -2 && (!to || several)) at += (r->derived ? k : 1)*bytes;
    }
    for (long i = 0; i < c->nreturned; ++i)
        if (c->returns[i].zeros) {
            PyArrayObject *const x = (PyArrayObject *)PyTuple_GET_ITEM(arrays, i);
            memset(PyArray_DATA(x), 0, PyArray_NBYTES(x));
        }
}

static size_t bytes_of(const Call *c, long states, long k)
{
    const long n = states ? states : 1;
    long numbers = c->work + c->lanes;
    for (long i = 0; i < c->ntaken; ++i) numbers += n*c->takes[i].size;
    for (long i = 0; i < c->nseeds; ++i) numbers += n*k*c->seeds[i].size;
    for (long i = 0; i < c->nresults; ++i) numbers += (c->results[i].derived ? k : 1)*c->results[i].size;
    return numbers*c->item + (n + 1)*sizeof(double);
}

static PyObject *called(PyObject *self, PyObject *const *arguments, size_t nargs, PyObject *names)
{
    const Call *const c = (Call *)self;
    job j;
    long states, k;
    if (PyVectorcall_NARGS(nargs) != 3 || names) {
        PyErr_SetString(PyExc_TypeError, "a call takes arguments, seeds and places of results");
        return NULL;
    }
    PyObject *const given = arguments[0], *const seeds = arguments[1], *const out = arguments[2];
    if (!PyTuple_CheckExact(given) || PyTuple_GET_SIZE(given) != c->ntaken) Py_RETURN_NONE;
    if (c->nseeds ? !PyTuple_CheckExact(seeds) || PyTuple_GET_SIZE(seeds) != c->nseeds : seeds != Py_None) Py_RETURN_NONE;
    if (!count(c, given, seeds, &states, &k)) Py_RETURN_NONE;
    way w = {0};
    if (states > (c->nseeds ? c->few_along : c->few)) {
        const int known = ask_way(c, states, k, &w);
        if (known < 0) return NULL;
        if (!known) Py_RETURN_NONE;
    }
    PyObject *wanted = NULL, *arrays = NULL;
    if (out != Py_None) {
        if (!(wanted = places(c, out, states, k))) goto none;
        if (!overlaps_any(wanted, given) && !(c->nseeds && overlaps_any(wanted, seeds))) arrays = Py_NewRef(wanted);
    }
    if (!arrays && !(arrays = new_arrays(c, states, k))) goto none;
    int status = 1;
    if (w.run) {
        status = !compute_states(c, &w, given, seeds, arrays, states, k);
        goto finished;
    }
    const size_t size = bytes_of(c, states, k);
    block *const memory = take_block(c->memory, size);
    if (!memory) goto none;
    char *const base = (char *)memory + 64;
    memcpy(j.x, c->pointers, sizeof j.x);
    j.nmoves = j.nrows = j.given = j.t_moves = 0;
    j.x[c->at_work] = base;
    j.x[c->at_lanes] = base + c->work*c->item;
    char *at = base + (c->work + c->lanes)*c->item;
    at += -(size_t)at % sizeof(double);
    if ((at = take_all(c, &j, given, seeds, states, k, at))) {
        place_results(c, &j, arrays, states, k, at);
        Py_BEGIN_ALLOW_THREADS
        status = compute(c, &j, states, k);
        Py_END_ALLOW_THREADS
    }
    give_block(c, memory);
finished:
    if (status) goto none;
    if (!wanted) return arrays;
    if (wanted != arrays) copy_arrays(wanted, arrays);
    Py_DECREF(arrays);
    return wanted;
none:
    PyErr_Clear();
    Py_XDECREF(arrays);
    Py_XDECREF(wanted);
    Py_RETURN_NONE;
}

/* ---- creation of calls -------------------------------------------------------------------------------------------------- */

static int read_taken(PyObject *list, taken *to, long *n)
{
    *n = (long)PyList_GET_SIZE(list);
    if (*n > MOST_TAKEN) return PyErr_SetString(PyExc_ValueError, "too many arguments"), -1;
    for (long i = 0; i < *n; ++i) {
        unsigned long long rest;
        taken *const a = to + i;
        PyObject *const item = PyList_GET_ITEM(list, i);
        if (!PyArg_ParseTuple(item, "lllOKl", &a->slot, &a->size, &a->needed, &a->names, &rest, &a->array)) return -1;
        if (a->names == Py_None) a->names = NULL;
        a->rest = (const char *)(uintptr_t)rest;
    }
    return 0;
}

static int read_results(Call *c, PyObject *results, PyObject *returns)
{
    c->nresults = (long)PyList_GET_SIZE(results);
    c->nreturned = (long)PyList_GET_SIZE(returns);
    if (c->nresults > MOST_RESULTS || c->nreturned > MOST_RESULTS || c->at_results + c->nresults > MOST_POINTERS)
        return PyErr_SetString(PyExc_ValueError, "too many results"), -1;
    for (long i = 0; i < c->nresults; ++i) {
        result *const r = c->results + i;
        if (!PyArg_ParseTuple(PyList_GET_ITEM(results, i), "llll", &r->size, &r->derived, &r->place, &r->array)) return -1;
    }
    for (long i = 0; i < c->nreturned; ++i) {
        returned *const r = c->returns + i;
        PyObject *shape;
        if (!PyArg_ParseTuple(PyList_GET_ITEM(returns, i), "iiO!", &r->derived, &r->zeros, &PyTuple_Type, &shape)) return -1;
        if ((r->nd = (int)PyTuple_GET_SIZE(shape)) > MOST_AXES) return PyErr_SetString(PyExc_ValueError, "too many axes"), -1;
        for (int l = 0; l < r->nd; ++l) r->shape[l] = PyLong_AsSsize_t(PyTuple_GET_ITEM(shape, l));
    }
    return PyErr_Occurred() ? -1 : 0;
}

static PyObject *new_call(PyTypeObject *type, PyObject *arguments, PyObject *named)
{
    static char *words[] = { "pool", "function", "item", "sizes", "few", "pointers", "takes", "seeds", "results", "returns",
        "kept", "large", NULL };
    PyObject *memory, *pointers, *takes, *seeds, *results, *returns, *kept, *large, *quaternions;
    double least;
    unsigned long long run;
    long item, work, lanes, at_work, at_lanes, few, few_along, narrays, work_of_states;
    if (!PyArg_ParseTupleAndKeywords(arguments, named, "OKl(llll)(ll)O!O!O!O!O!O(OllO!d)", words, &memory, &run, &item, &work, &lanes,
            &at_work, &at_lanes, &few, &few_along, &PyList_Type, &pointers, &PyList_Type, &takes, &PyList_Type, &seeds,
            &PyList_Type, &results, &PyList_Type, &returns, &kept, &large, &narrays,
            &work_of_states, &PyTuple_Type, &quaternions, &least)) return NULL;
    pool *const p = PyCapsule_GetPointer(memory, POOL);
    Call *const c = p ? (Call *)type->tp_alloc(type, 0) : NULL;
    if (!c) return NULL;
    c->call = called;
    c->memory = p;
    c->run = (function)(uintptr_t)run;
    c->item = (size_t)item;
    c->type = item == sizeof(double) ? NPY_DOUBLE : NPY_FLOAT;
    c->work = work, c->lanes = lanes, c->at_work = at_work, c->at_lanes = at_lanes, c->few = few, c->few_along = few_along;
    c->at_results = (long)PyList_GET_SIZE(pointers);
    c->kept = Py_BuildValue("(OOOOOO)", memory, takes, seeds, kept, large, quaternions);
    if (!c->kept || c->at_results > MOST_POINTERS) goto failed;
    c->large = large == Py_None || narrays > MOST_ARRAYS ? NULL : large;
    c->narrays = narrays, c->work_of_states = work_of_states, c->quaternions = quaternions, c->least = least;
    for (long i = 0; i < c->at_results; ++i) c->pointers[i] = PyLong_AsVoidPtr(PyList_GET_ITEM(pointers, i));
    if (read_taken(takes, c->takes, &c->ntaken) || read_taken(seeds, c->seeds, &c->nseeds)) goto failed;
    if (read_results(c, results, returns)) goto failed;
    for (long i = 0; i < c->ntaken; ++i)
        if (c->takes[i].needed > 0) c->needed |= 1L << c->takes[i].slot;
    return (PyObject *)c;
failed:
    Py_DECREF(c);
    return NULL;
}

static void free_call(PyObject *self)
{
    Py_XDECREF(((Call *)self)->kept);
    Py_TYPE(self)->tp_free(self);
}

static PyTypeObject CallType = {
    PyVarObject_HEAD_INIT(NULL, 0)
    .tp_name = "ordernm_call.Call",
    .tp_basicsize = sizeof(Call),
    .tp_dealloc = free_call,
    .tp_flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_VECTORCALL,
    .tp_call = PyVectorcall_Call,
    .tp_vectorcall_offset = offsetof(Call, call),
    .tp_new = new_call,
    .tp_doc = "A function of NAME_calls.c: call(arguments, seeds, places of results) returns a tuple of arrays, or None.",
};

static PyMethodDef functions[] = {
    { "pool", new_pool, METH_NOARGS, "Memory that calls of one package share." },
    { NULL, NULL, 0, NULL },
};

static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "ordernm_call", "Calls of compiled functions.", -1, functions, NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit_ordernm_call(void)
{
    import_array();
    if (PyType_Ready(&CallType) < 0) return NULL;
    PyObject *const m = PyModule_Create(&module);
    if (m && PyModule_AddObjectRef(m, "Call", (PyObject *)&CallType) < 0) {
        Py_DECREF(m);
        return NULL;
    }
    return m;
}
