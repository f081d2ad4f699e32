/* Calls functions of a generated header as a file of doubles says, on memory that holds exactly what the header documents.
 *
 * calls.h, written for each package, has a table of its functions. The input holds calls, one after the other:
 *     function, count (-1: of the loop over a batch: none), shift,
 *     for every argument its number of doubles, its step from state to state, and the doubles,
 *     for every result its number of doubles and its step.
 * Every call is made twice, with other rubbish in the workspace and in the results. What comes out goes to the output: status,
 * number of the state that failed (-1: none) and, if none did, the results. Memory errors are the sanitizer's to find; here is
 * found: arguments that were written to, results that were not, or that depend on what was in the workspace before.
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "calls.h"

#if defined(__has_feature)
#if __has_feature(address_sanitizer)
#define ADDRESS_SANITIZER 1
#endif
#if __has_feature(memory_sanitizer)
#include <sanitizer/msan_interface.h>
#define MEMORY_SANITIZER 1
#endif
#elif defined(__SANITIZE_ADDRESS__)
#define ADDRESS_SANITIZER 1
#endif
#ifdef ADDRESS_SANITIZER
#include <sanitizer/asan_interface.h>
#endif

enum { MOST = 16 };

static const uint64_t rubbish[2] = { 0x7ff8dead0000beef, 0xfff8beef0000dead }; /* numbers that are none, and easily told */

/* Memory of exactly so many doubles, which begins 8*shift bytes beyond a multiple of 64. */
typedef struct {
    void *base;
    double *x;
    size_t n;
} room;

static void give_up(const char *what, const char *function)
{
    fprintf(stderr, "harness: %s: %s\n", function, what);
    exit(2);
}

static room make_room(size_t n, size_t shift)
{
    room r;
    shift %= 8;
    if (posix_memalign(&r.base, 64, 8*(shift + n))) give_up("no memory", "");
    r.x = (double *)r.base + shift;
    r.n = n;
#ifdef ADDRESS_SANITIZER
    ASAN_POISON_MEMORY_REGION(r.base, 8*shift);
#endif
    return r;
}

static void soil(room r, int which)
{
    if (r.n) memcpy(r.x, rubbish + which, 8);
    for (size_t done = 1; done < r.n; done *= 2) /* few calls: the sanitizer looks at each */
        memcpy(r.x + done, r.x, 8*(2*done < r.n ? done : r.n - done));
#ifdef MEMORY_SANITIZER
    if (!which) __msan_poison(r.x, 8*r.n);
#endif
}

static void check_result(room r, int which, const char *function)
{
#ifdef MEMORY_SANITIZER
    __msan_check_mem_is_initialized(r.x, 8*r.n);
#endif
    for (size_t i = 0; i < r.n; ++i) {
        uint64_t bits;
        memcpy(&bits, r.x + i, 8);
        if (bits == rubbish[which]) give_up("a result was not written, or is made of the workspace's rubbish", function);
    }
}

static int same(room a, room b)
{
    return !a.n || !memcmp(a.x, b.x, 8*a.n);
}

static double number(FILE *from)
{
    double x;
    if (fread(&x, 8, 1, from) != 1) give_up("the input ends early", "");
    return x;
}

static void call(const function *f, FILE *in, FILE *out)
{
    room given[MOST], before[MOST], results[2][MOST];
    double *a[2*MOST];
    long steps[2*MOST];
    int status[2];
    long failed[2] = { -1, -1 };
    const long count = (long)number(in);
    const size_t shift = (size_t)number(in);

    for (int i = 0; i < f->arguments; ++i) {
        given[i] = make_room((size_t)number(in), shift + 3*(size_t)i);
        before[i] = make_room(given[i].n, 0);
        steps[i] = (long)number(in);
        for (size_t j = 0; j < given[i].n; ++j) before[i].x[j] = given[i].x[j] = number(in);
        a[i] = given[i].x;
    }
    for (int i = 0; i < f->results; ++i) {
        const size_t n = (size_t)number(in);
        steps[f->arguments + i] = (long)number(in);
        for (int which = 0; which < 2; ++which) results[which][i] = make_room(n, shift + 5*(size_t)i + 1);
    }
    for (int which = 0; which < 2; ++which) {
        room work = make_room(WORKSPACE, shift + 3 + 4*(size_t)which);
        soil(work, which);
        for (int i = 0; i < f->results; ++i) {
            soil(results[which][i], which);
            a[f->arguments + i] = results[which][i].x;
        }
        status[which] = f->call(a, steps, count, failed + which, work.x);
        if (!status[which])
            for (int i = 0; i < f->results; ++i) check_result(results[which][i], which, f->name);
        free(work.base);
    }
    if (status[0] != status[1] || failed[0] != failed[1]) give_up("the status depends on what was in the workspace", f->name);
    for (int i = 0; i < f->arguments; ++i) {
        if (!same(given[i], before[i])) give_up("an argument was written to", f->name);
        free(given[i].base);
        free(before[i].base);
    }
    const double head[2] = { status[0], (double)failed[0] };
    fwrite(head, 8, 2, out);
    for (int i = 0; i < f->results; ++i) {
        if (!status[0]) {
            if (!same(results[0][i], results[1][i])) give_up("a result depends on what was in the workspace", f->name);
            fwrite(results[0][i].x, 8, results[0][i].n, out);
        }
        free(results[0][i].base);
        free(results[1][i].base);
    }
}

int main(int count, char **names)
{
    FILE *const in = count == 3 ? fopen(names[1], "rb") : NULL;
    FILE *const out = count == 3 ? fopen(names[2], "wb") : NULL;
    double which;
    if (!in || !out) give_up("needs an input and an output", "");
    while (fread(&which, 8, 1, in) == 1) call(functions + (int)which, in, out);
    if (fclose(out)) give_up("the output cannot be written", "");
    fclose(in);
    return 0;
}
