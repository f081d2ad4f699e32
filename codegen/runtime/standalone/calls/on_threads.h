/* on_threads.h: runs a function for a batch of states on several threads. NAME_threads.c of a package includes this file and defines
 *
 *     MOST_LANES          largest number of SIMD lanes
 *     BATCH               struct of a batch, NAME_states
 *     WORKSPACE           size of the workspace of each thread
 *     EACH_ARRAY(DO)      DO(array) for each member of BATCH that is an array with a stride between states
 *     ON_THREADS          name of the function defined here, NAME_on_threads
 *
 * Threads wait actively for the next batch before they sleep, so that sharing pays for batches of 0.1 ms. Each thread has a share of
 * the states, always the same one because of its cache. It takes its share chunk by chunk, then chunks of other shares. A batch is open
 * while there are chunks left. The caller does not wait for threads that come too late. */
#ifndef _POSIX_C_SOURCE
#define _POSIX_C_SOURCE 200809L
#endif
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdint.h>
#include <time.h>

#ifdef __cplusplus
#include <atomic>
using namespace std; /* atomic_long and its functions */
#else
#include <stdalign.h>
#include <stdatomic.h>
#endif

enum { MOST_THREADS = 256, CHUNKS = 8 /* per thread */, EVEN = MOST_LANES, LEAST = 4*EVEN };
static const long LOOKING = 100000; /* ns that a thread searches for work before it sleeps */

/* The open batch: its function, data, chunks and number of threads. */
static int (*called)(BATCH *);
static const BATCH *whole;
static long chunk;
static int wanted;

/* The states of each thread (states before `untaken` are being computed or done), and the first singular state that it found. */
static struct {
    alignas(128) atomic_long untaken;
    long end, failed;
    int code, infinite;
} shares[MOST_THREADS];

static atomic_uint open_batch;    /* number of the open batch, 0 if none is open */
static atomic_int inside;         /* threads that may be reading the data above */
static atomic_int busy, sleeping; /* whether a batch is being computed; number of sleeping threads */
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t opened = PTHREAD_COND_INITIALIZER;
static unsigned batches; /* number of batches so far */
static int threads;      /* number of started threads */

static void pause_briefly(void)
{
#if defined(__GNUC__) && (defined(__x86_64__) || defined(__i386__))
    __builtin_ia32_pause();
#endif
}

static long now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec*1000000000L + t.tv_nsec;
}

/* Computes states of the open batch from `begin` on. */
static void take_chunk(int thread, long begin, long end)
{
    BATCH b = *whole;
    b.count = end - begin < chunk ? end - begin : chunk;
    b.work += thread*(long)WORKSPACE;
    if (b.codes) b.codes += begin;
#define MOVE_ON(array) if (b.array.at) b.array.at += begin*b.array.state;
    EACH_ARRAY(MOVE_ON)
    const int code = called(&b);
    shares[thread].infinite |= b.infinite;
    if (code && (shares[thread].failed < 0 || begin + b.failed < shares[thread].failed)) {
        shares[thread].failed = begin + b.failed;
        shares[thread].code = b.code;
    }
}

/* Computes chunks of the open batch until all are taken. */
static void take_chunks(int thread)
{
    for (int further = 0; further < wanted; ++further) {
        const int share = (thread + further) % wanted;
        for (long begin; (begin = atomic_fetch_add(&shares[share].untaken, chunk)) < shares[share].end;)
            take_chunk(thread, begin, shares[share].end);
    }
}

/* The loop of every thread: takes part in each new open batch. */
static void *help(void *number)
{
    const int thread = (int)(intptr_t)number;
    unsigned seen = 0;
    for (;;) {
        unsigned next;
        const long begin = now();
        for (long looks = 1; !(next = atomic_load(&open_batch)) || next == seen; ++looks) {
            pause_briefly();
            if (looks % 64) continue;
            sched_yield(); /* the caller may need this core */
            if (now() - begin < LOOKING) continue;
            pthread_mutex_lock(&lock);
            atomic_fetch_add(&sleeping, 1);
            while (!(next = atomic_load(&open_batch)) || next == seen) pthread_cond_wait(&opened, &lock);
            atomic_fetch_sub(&sleeping, 1);
            pthread_mutex_unlock(&lock);
            break;
        }
        atomic_fetch_add(&inside, 1);
        next = atomic_load(&open_batch); /* the batch may have been closed before `inside` was increased */
        if (next && next != seen) {
            if (thread < wanted) take_chunks(thread);
            seen = next;
        }
        atomic_fetch_sub(&inside, 1);
    }
    return 0;
}

/* After a fork: the child process has none of the threads, and locks may be held. */
static void begin_anew(void)
{
    static const pthread_mutex_t fresh_lock = PTHREAD_MUTEX_INITIALIZER;
    static const pthread_cond_t fresh_condition = PTHREAD_COND_INITIALIZER;
    lock = fresh_lock;
    opened = fresh_condition;
    threads = 0;
    atomic_store(&open_batch, 0);
    atomic_store(&inside, 0);
    atomic_store(&sleeping, 0);
    atomic_store(&busy, 0);
}

/* Starts threads until there are `more` in addition to the caller, or as many as the system permits. The started threads receive no
 * signals. */
static void start(int more)
{
    static int prepared;
    sigset_t all, usual;
    if (!prepared && pthread_atfork(0, 0, begin_anew)) return;
    prepared = 1;
    sigfillset(&all);
    if (pthread_sigmask(SIG_SETMASK, &all, &usual)) return;
    for (pthread_t thread; threads < more; ++threads) {
        if (pthread_create(&thread, 0, help, (void *)(intptr_t)(threads + 1))) break;
        pthread_detach(thread);
    }
    pthread_sigmask(SIG_SETMASK, &usual, 0);
}

int ON_THREADS(int (*function)(BATCH *), BATCH *b, int count)
{
    if (count > MOST_THREADS) count = MOST_THREADS;
    if (count < 2 || b->count < 2*LEAST || atomic_exchange(&busy, 1)) return function(b); /* another caller uses the threads */
    if (threads < count - 1) start(count - 1);
    called = function;
    whole = b;
    wanted = count;
    chunk = b->count/((long)CHUNKS*count)/EVEN*EVEN;
    if (chunk < LEAST) chunk = LEAST;
    const long share = (b->count + (long)EVEN*count - 1)/((long)EVEN*count)*EVEN;
    for (int i = 0; i < count; ++i) {
        atomic_store(&shares[i].untaken, i*share);
        shares[i].end = (i + 1)*share < b->count ? (i + 1)*share : b->count;
        shares[i].failed = -1;
        shares[i].code = shares[i].infinite = 0;
    }
    if (!++batches) ++batches; /* 0 means that no batch is open */
    atomic_store(&open_batch, batches);
    if (atomic_load(&sleeping)) {
        pthread_mutex_lock(&lock);
        pthread_cond_broadcast(&opened);
        pthread_mutex_unlock(&lock);
    }
    take_chunks(0);
    atomic_store(&open_batch, 0);
    for (long looks = 1; atomic_load(&inside); ++looks) { /* this takes at most one chunk, unless a thread has lost its core */
        pause_briefly();
        if (looks % 64 == 0) sched_yield();
    }
    b->failed = -1;
    b->code = b->infinite = 0;
    for (int i = 0; i < count; ++i) {
        b->infinite |= shares[i].infinite;
        if (shares[i].failed >= 0 && (b->failed < 0 || shares[i].failed < b->failed)) {
            b->failed = shares[i].failed;
            b->code = shares[i].code;
        }
    }
    atomic_store(&busy, 0);
    return b->code;
}
