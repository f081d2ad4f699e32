/* Masked loads and stores of AVX, lane by lane: clang's memory sanitizer takes what vmaskmovpd stores for uninitialised. */
#if defined(__AVX__) && !defined(ORDERNM_PLAIN_C)
#include <immintrin.h>

static inline __m256d load_lanes(const double *from, __m256i mask)
{
    __m256d x = _mm256_setzero_pd();
    for (int i = 0; i < 4; ++i) if (((__v4di)mask)[i] < 0) x[i] = from[i];
    return x;
}

static inline void store_lanes(double *to, __m256i mask, __m256d x)
{
    for (int i = 0; i < 4; ++i) if (((__v4di)mask)[i] < 0) to[i] = x[i];
}

#define _mm256_maskload_pd load_lanes
#define _mm256_maskstore_pd store_lanes
#endif
