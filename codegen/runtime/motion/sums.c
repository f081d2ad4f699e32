/* Sums of arrays: stages of a step and its interpolant. */
#include "inside.h"

/* Vectors with the machine's SIMD width; several fit a cache line. */
#if defined(__GNUC__) && defined(__AVX512F__)
enum { WIDE = 8 };
#elif defined(__GNUC__) && defined(__AVX__)
enum { WIDE = 4 };
#elif defined(__GNUC__)
enum { WIDE = 2 };
#else
enum { WIDE = 1 };
#endif
#ifdef __GNUC__
typedef scalar vector __attribute__((vector_size(8*WIDE), aligned(8*WIDE), may_alias));
#else
typedef scalar vector;
#endif

/* out = z + h*sum(factor*rate[which]); n is a multiple of 8, and arrays start at cache lines. Four vectors at a time, in separate
 * variables, because at -O2 an array of sums would be kept in memory. */
void ordernm_combine(long n, scalar *out, const scalar *z, scalar h, int count, const int *which, const scalar *factor,
    scalar *const *rate)
{
    scalar by[MOST_STAGES];
    for (int j = 0; j < count; ++j) by[j] = h*factor[j];
    long i = 0;
    for (; i + 4*WIDE <= n; i += 4*WIDE) {
        const vector *const from = (const vector *)(z + i);
        vector *const to = (vector *)(out + i);
        vector first = from[0], second = from[1], third = from[2], fourth = from[3];
        for (int j = 0; j < count; ++j) {
            const vector *const of = (const vector *)(rate[which[j]] + i);
            first += by[j]*of[0];
            second += by[j]*of[1];
            third += by[j]*of[2];
            fourth += by[j]*of[3];
        }
        to[0] = first;
        to[1] = second;
        to[2] = third;
        to[3] = fourth;
    }
    for (; i < n; i += WIDE) {
        vector sum = *(const vector *)(z + i);
        for (int j = 0; j < count; ++j) sum += by[j]**(const vector *)(rate[which[j]] + i);
        *(vector *)(out + i) = sum;
    }
}

int ordernm_all_finite(const scalar *x, long n)
{
    scalar sum = 0.0;
    for (long i = 0; i < n; ++i) sum += 0.0*x[i];
    return sum == 0.0;
}

/* Whether the derivatives of n entries along a direction are finite. */
int ordernm_finite_along(const scalar *S, long n, int width, int lane)
{
    scalar sum = 0.0;
    for (long i = 0; i < n; ++i) sum += 0.0*S[i*width + lane];
    return sum == 0.0;
}
