/* Dense linear equations, real and complex, with one number or several lanes for each entry of right sides. */
#ifndef ORDERNM_LINEAR_H
#define ORDERNM_LINEAR_H

#include "inside.h"

#ifdef __GNUC__
typedef scalar eight __attribute__((vector_size(64), aligned(8), may_alias));
#endif

/* x -= sum(a[j]*y[j]) for j < count; x and y[j] are numbers or LANES of them. */
static inline void subtract(scalar *x, const scalar *a, const scalar *y, int count, int width)
{
    int j = 0;
#ifdef __GNUC__
    eight sum = {0.0};
    if (width == LANES) {
        for (; j < count; ++j) sum += a[j]**(const eight *)(y + (long)j*LANES);
        *(eight *)x -= sum;
        return;
    }
    if (width == 1 && count >= 8) {
        for (; j + 8 <= count; j += 8) sum += *(const eight *)(a + j)**(const eight *)(y + j);
        *x -= ((sum[0] + sum[4]) + (sum[1] + sum[5])) + ((sum[2] + sum[6]) + (sum[3] + sum[7]));
    }
#endif
    for (; j < count; ++j)
        for (int l = 0; l < width; ++l) x[l] -= a[j]*y[(long)j*width + l];
}

/* x -= f*y for arrays of length count. */
static inline void subtract_row(scalar *x, scalar f, const scalar *y, int count)
{
    int j = 0;
#ifdef __GNUC__
    for (; j + 8 <= count; j += 8) *(eight *)(x + j) -= f**(const eight *)(y + j);
#endif
    for (; j < count; ++j) x[j] -= f*y[j];
}

/* LU factors in place, with row exchanges: L has a unit diagonal, the diagonal of U is inverted. Returns 1 if a pivot is zero or not
 * finite. */
int ordernm_factorise(int n, scalar *a, int *pivot);
int ordernm_factorise_complex(int n, scalar *re, scalar *im, int *pivot);

/* Solve with the matrix, or with its transpose; x, [n][width], contains the right sides, then the solutions. */
void ordernm_solve(int n, const scalar *a, const int *pivot, scalar *x, int width);
void ordernm_solve_transposed(int n, const scalar *a, const int *pivot, scalar *x, int width);

/* Solve for complex right sides x + iy, in place; z is scratch for -y. */
void ordernm_solve_complex(int n, const scalar *re, const scalar *im, const int *pivot, scalar *x, scalar *y, scalar *z,
    int width);
void ordernm_solve_complex_transposed(int n, const scalar *re, const scalar *im, const int *pivot, scalar *x, scalar *y,
    int width);

#endif
