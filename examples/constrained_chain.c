/* Equations with multipliers for a chain of hinges whose links are pinned to the ground: the foils of paper_loops.py.
 *
 *     M udot = K + J^T lambda          S lambda = -(b + J M^-1 K),   S = J M^-1 J^T,   b = Jdot u
 *     J udot = -b
 *
 * and along one direction (dq, du, dL), which must be consistent with closure (J dq = 0, ...), at fixed udot and lambda
 *
 *     M dudot = dK - dM udot + dJ^T lambda + J^T dlambda          S dlambda = -(db + dJ udot) - J M^-1 (dK - dM udot + dJ^T lambda)
 *
 * Two ways, both with all that handwork can do while S is dense:
 *   TREE 0   M, K and dM dense as in dense_chain.c (Eqs. 4-9), Cholesky: O(n^3 + n^2 m + n m^2 + m^3);
 *   TREE 1   M is never formed: the generated O(n) recursion of the tree (tree_solves.c) gives M^-1 K and M^-1 J^T, eight
 *            columns at a time: O(n + n m + n m^2 + m^3).
 * J x, J^T y and their tangents are recursions, O(n + m). S is summed up to where the shorter row ends, in tiles of 8 x 8, and
 * factored in tiles. The dense way numbers joints from the tip, so that rows of L^-1 J^T begin where those of J do.
 *
 * tables.h describes the chain: JOINTS and their axes (0 x, 1 y, 2 z) and places over L, the rods (1 + axis, with the sign, or
 * 0 for none), LOOPS by joint and place, of type 0 (hinge about y of the ground) or 1 (Hooke: x of the body, y of the ground).
 */
#include "rods.h"
#include "tables.h"

typedef double lane __attribute__((vector_size(64)));

enum { TILES = (JOINTS + 7) / 8, GROUPS = (ROWS + 7) / 8, MOST = TILES > GROUPS ? TILES : GROUPS };
#define TILE(T, g, h) ((T) + 8 * ((g) * ((g) + 1) / 2 + (h)))
#define LAST(g) (loops[row_loop[8 * (g) + 7 < ROWS ? 8 * (g) + 7 : ROWS - 1]].joint)

/* --- dense algebra in tiles of 8 x 8, lower triangles --- */

/* The factor of a tile in place, one over its diagonal, and its inverse, transposed. */
static void factor_tile(double *a, double *pivot, double *inverse)
{
    for (int k = 0; k < 8; ++k) {
        for (int j = 0; j < k; ++j)
            for (int r = k; r < 8; ++r) a[8 * r + k] -= a[8 * r + j] * a[8 * k + j];
        pivot[k] = 1 / sqrt(a[9 * k]);
        for (int r = k; r < 8; ++r) a[8 * r + k] *= pivot[k];
    }
    memset(inverse, 0, 64 * sizeof(double));
    for (int j = 0; j < 8; ++j)
        for (int i = j; i < 8; ++i) {
            double x = i == j;
            for (int k = j; k < i; ++k) x -= a[8 * i + k] * inverse[8 * j + k];
            inverse[8 * j + i] = x * pivot[i];
        }
}

/* c -= a b, or c += a b */
static inline void subtract(lane *c, const double *a, const lane *b)
{
    for (int j = 0; j < 8; ++j)
        for (int r = 0; r < 8; ++r) c[r] -= a[8 * r + j] * b[j];
}

static void cholesky(lane *T, int tiles, int size, double *pivot)
{
    static lane turned[8 * MOST], inverse[8];
    OPERATIONS(((double)size * size * size - size) / 3 + size * (size - 1) / 2);
    for (int h = 0; h < tiles; ++h) {
        for (int k = 0; k < h; ++k) {
            const double *a = (const double *)TILE(T, h, k);
            double *b = (double *)(turned + 8 * k);
            for (int i = 0; i < 8; ++i)
                for (int j = 0; j < 8; ++j) b[8 * j + i] = a[8 * i + j];
        }
        for (int g = h; g < tiles; ++g) {
            lane c[8], *tile = TILE(T, g, h);
            memcpy(c, tile, sizeof c);
            for (int k = 0; k < h; ++k) subtract(c, (const double *)TILE(T, g, k), turned + 8 * k);
            memcpy(tile, c, sizeof c);
            if (g == h)
                factor_tile((double *)tile, pivot + 8 * h, (double *)inverse);
            else
                for (int r = 0; r < 8; ++r) {
                    const double *row = (const double *)(c + r);
                    lane x = row[0] * inverse[0];
                    for (int j = 1; j < 8; ++j) x += row[j] * inverse[j];
                    tile[r] = x;
                }
        }
    }
}

static double sum(lane x)
{
    return ((x[0] + x[4]) + (x[1] + x[5])) + ((x[2] + x[6]) + (x[3] + x[7]));
}

/* x = (L L^T)^-1 x */
static void solve(const lane *T, int tiles, int size, const double *pivot, double *x)
{
    lane *const in = (lane *)x;
    OPERATIONS(2.0 * size * size);
    for (int g = 0; g < tiles; ++g) {
        lane c[8] = {{0}};
        double *y = x + 8 * g;
        const double *d = (const double *)TILE(T, g, g);
        for (int k = 0; k < g; ++k)
            for (int r = 0; r < 8; ++r) c[r] += TILE(T, g, k)[r] * in[k];
        for (int r = 0; r < 8; ++r) {
            y[r] -= sum(c[r]);
            for (int j = 0; j < r; ++j) y[r] -= d[8 * r + j] * y[j];
            y[r] *= pivot[8 * g + r];
        }
    }
    for (int g = tiles - 1; g >= 0; --g) {
        double *y = x + 8 * g;
        const double *d = (const double *)TILE(T, g, g);
        for (int r = 7; r >= 0; --r) {
            y[r] *= pivot[8 * g + r];
            for (int j = 0; j < r; ++j) y[j] -= d[8 * r + j] * y[r];
        }
        for (int k = 0; k < g; ++k)
            for (int r = 0; r < 8; ++r) in[k] -= TILE(T, g, k)[r] * y[r];
    }
}

/* --- the chain --- */

/* A joint and its body; partial velocities about the ground's origin are (z, y). In a tangent `at` is that of the place. */
typedef struct {
    rod body;
    vector X, Y, Z, o, z, y, w, v, alpha, a, n, f;
} state;

static state s[JOINTS], t[JOINTS], ground;
static lane JT[GROUPS][JOINTS], X[GROUPS][8 * TILES], S[8 * GROUPS * (GROUPS + 1) / 2];
static double pivot_of_S[8 * GROUPS];
#if TREE
int tree_forward(const double *q, const double *u, const double *p, double *udot, double *work);
void tree_solve_8(const double *b, double *x, double *work);
void tree_solve_1(const double *b, double *x, double *work);
void tree_force_tangent(double *udot, const double *dq, const double *du, const double *dp, double *force, double *dforce,
                        double *work);
static double work[WORK];
#else
static lane M[8 * TILES * (TILES + 1) / 2];
static double pivot_of_M[8 * TILES];
#endif

static inline vector combined(const double *c, const state *b)
{
    vector r = {0, 0, 0};
    if (c[0]) r = add(r, mul(c[0], b->X));
    if (c[1]) r = add(r, mul(c[1], b->Y));
    if (c[2]) r = add(r, mul(c[2], b->Z));
    return r;
}

static void outward(const double *q, const double *u, double L)
{
    ground = (state){.X = {1, 0, 0}, .Y = {0, 1, 0}, .Z = {0, 0, 1}, .a = {0, 0, GRAVITY}};
    for (int k = 0; k < JOINTS; ++k) {
        const state *p = k ? s + k - 1 : &ground;
        state *b = s + k;
        const int axis = joints[k].axis, rod_axis = joints[k].rod;
        const double c = cos(q[k]), si = sin(q[k]);
        b->o = joints[k].moved ? add(p->o, mul(L, combined(joints[k].at, p))) : p->o;
        b->X = p->X; b->Y = p->Y; b->Z = p->Z;
        if (axis == 0) {
            b->z = p->X;
            b->Y = add(mul(c, p->Y), mul(si, p->Z));
            b->Z = sub(mul(c, p->Z), mul(si, p->Y));
        } else if (axis == 1) {
            b->z = p->Y;
            b->Z = add(mul(c, p->Z), mul(si, p->X));
            b->X = sub(mul(c, p->X), mul(si, p->Z));
        } else {
            b->z = p->Z;
            b->X = add(mul(c, p->X), mul(si, p->Y));
            b->Y = sub(mul(c, p->Y), mul(si, p->X));
        }
        b->y = cross(b->o, b->z);
        b->w = add(p->w, mul(u[k], b->z));
        b->v = add(p->v, mul(u[k], b->y));
        b->alpha = add(p->alpha, mul(u[k], cross(b->w, b->z)));
        b->a = add(p->a, mul(u[k], add(cross(b->w, b->y), cross(b->v, b->z))));
        if (rod_axis) {
            const int i = rod_axis < 0 ? -rod_axis : rod_axis;
            const vector e = mul(rod_axis < 0 ? -1 : 1, i == 1 ? b->X : i == 2 ? b->Y : b->Z);
            OPERATIONS(7);
            b->body = (rod){e, add(b->o, mul(L / 2, e)), L, L * (3 * RADIUS * RADIUS + L * L) / 12, L * RADIUS * RADIUS / 2};
        }
    }
}

/* Total derivatives; a turn of body k is delta x. */
static void outward_tangent(const double *q, const double *u, double L, const double *dq, const double *du, double dL)
{
    vector delta = {0, 0, 0};
    (void)q;
    for (int k = 0; k < JOINTS; ++k) {
        static const state rest;
        const state *p = k ? s + k - 1 : &ground, *dp = k ? t + k - 1 : &rest, *b = s + k;
        state *g = t + k;
        const int rod_axis = joints[k].rod;
        g->o = dp->o;
        if (joints[k].moved) {
            const vector r = combined(joints[k].at, p);
            g->o = add(g->o, add(mul(dL, r), mul(L, cross(delta, r))));
        }
        g->z = cross(delta, b->z);
        delta = add(delta, mul(dq[k], b->z));
        g->y = add(cross(g->o, b->z), cross(b->o, g->z));
        g->w = add(dp->w, add(mul(du[k], b->z), mul(u[k], g->z)));
        g->v = add(dp->v, add(mul(du[k], b->y), mul(u[k], g->y)));
        g->alpha = add(dp->alpha, add(mul(du[k], cross(b->w, b->z)), mul(u[k], add(cross(g->w, b->z), cross(b->w, g->z)))));
        g->a = add(dp->a, add(mul(du[k], add(cross(b->w, b->y), cross(b->v, b->z))),
                              mul(u[k], add(add(cross(g->w, b->y), cross(b->w, g->y)),
                                            add(cross(g->v, b->z), cross(b->v, g->z))))));
        if (rod_axis) {
            const vector e = b->body.e, de = cross(delta, e);
            OPERATIONS(9);
            g->body = (rod){de, add(g->o, add(mul(dL / 2, e), mul(L / 2, de))), dL,
                            dL * (RADIUS * RADIUS + L * L) / 4, dL * RADIUS * RADIUS / 2};
        }
        g->X = delta; /* for the axes of loops */
    }
}

/* --- loops: the place x of a foot, the axis c of a Hooke joint's row, and their rates and tangents --- */

typedef struct { vector x, c, dx, dc; } foot;
static foot feet[LOOPS];

static void find_feet(double L)
{
    for (int l = 0; l < LOOPS; ++l) {
        const state *b = s + loops[l].joint;
        feet[l].x = add(b->o, mul(L, combined(loops[l].at, b)));
        if (loops[l].type) feet[l].c = (vector){-b->X.z, 0, b->X.x}; /* X x (0, 1, 0) */
    }
}

static void find_feet_tangent(double L, double dL)
{
    for (int l = 0; l < LOOPS; ++l) {
        const state *b = s + loops[l].joint, *g = t + loops[l].joint;
        const vector r = combined(loops[l].at, b), dX = cross(g->X, b->X);
        feet[l].dx = add(g->o, add(mul(dL, r), mul(L, cross(g->X, r))));
        if (loops[l].type) feet[l].dc = (vector){-dX.z, 0, dX.x};
    }
}

/* A loop's rows, applied to a motion (w, v) of its body. */
static inline void rows_of(const foot *f, int type, vector w, vector v, double *row)
{
    const vector x = add(v, cross(w, f->x));
    row[0] = x.x; row[1] = x.y; row[2] = x.z;
    if (type)
        row[3] = dot3(f->c, w);
    else {
        row[3] = w.x;
        row[4] = w.z;
    }
}

static inline void rows_of_tangent(const foot *f, int type, vector w, vector v, vector dw, vector dv, double *row)
{
    const vector x = add(dv, add(cross(dw, f->x), cross(w, f->dx)));
    row[0] = x.x; row[1] = x.y; row[2] = x.z;
    if (type) {
        OPERATIONS(1);
        row[3] = dot3(f->dc, w) + dot3(f->c, dw);
    } else {
        row[3] = dw.x;
        row[4] = dw.z;
    }
}

/* J in groups of eight rows, columns as lanes. */
static void jacobian(void)
{
    for (int l = 0; l < LOOPS; ++l) {
        const int type = loops[l].type, first = loops[l].row, last = loops[l].joint;
        for (int i = 0; i <= last; ++i) {
            double row[5];
            rows_of(feet + l, type, s[i].z, s[i].y, row);
            for (int r = 0; r < 5 - type; ++r) ((double *)&JT[(first + r) / 8][i])[(first + r) % 8] = row[r];
        }
    }
}

/* J x, and with `tangent` dJ x */
static void times_J(const double *x, double *result, int tangent)
{
    vector w = {0, 0, 0}, v = w, dw = w, dv = w;
    for (int l = 0, i = 0; l < LOOPS; ++l) {
        for (; i <= loops[l].joint; ++i) {
            w = add(w, mul(x[i], s[i].z));
            v = add(v, mul(x[i], s[i].y));
            if (tangent) {
                dw = add(dw, mul(x[i], t[i].z));
                dv = add(dv, mul(x[i], t[i].y));
            }
        }
        double *row = result + loops[l].row;
        if (tangent)
            rows_of_tangent(feet + l, loops[l].type, w, v, dw, dv, row);
        else
            rows_of(feet + l, loops[l].type, w, v, row);
    }
}

/* J^T y, and with `tangent` dJ^T y */
static void times_JT(const double *y, double *result, int tangent)
{
    vector n = {0, 0, 0}, f = n, dn = n;
    for (int i = JOINTS - 1, l = LOOPS - 1; i >= 0; --i) {
        for (; l >= 0 && loops[l].joint == i; --l) {
            const double *row = y + loops[l].row;
            const vector force = {row[0], row[1], row[2]};
            const vector c = loops[l].type ? mul(row[3], feet[l].c) : (vector){row[3], 0, row[4]};
            n = add(n, add(cross(feet[l].x, force), c));
            f = add(f, force);
            if (tangent) {
                dn = add(dn, cross(feet[l].dx, force));
                if (loops[l].type) dn = add(dn, mul(row[3], feet[l].dc));
            }
        }
        OPERATIONS(tangent ? 2 : 1);
        result[i] = tangent ? dot3(t[i].z, n) + dot3(s[i].z, dn) + dot3(t[i].y, f) : dot3(s[i].z, n) + dot3(s[i].y, f);
    }
}

/* b = Jdot u: what is left of the accelerations of the feet at udot = 0. */
static void bias(double *result)
{
    for (int l = 0; l < LOOPS; ++l) {
        const state *b = s + loops[l].joint;
        const vector X = b->X, vx = add(b->v, cross(b->w, feet[l].x));
        double *row = result + loops[l].row;
        rows_of(feet + l, loops[l].type, b->alpha, b->a, row);
        const vector turned = cross(b->w, vx);
        OPERATIONS(4);
        row[0] += turned.x; row[1] += turned.y; row[2] += turned.z - GRAVITY;
        if (loops[l].type) {
            const vector Xdot = cross(b->w, X);
            OPERATIONS(4);
            row[3] += b->w.z * Xdot.x - b->w.x * Xdot.z;
        }
    }
}

static void bias_tangent(double *result)
{
    for (int l = 0; l < LOOPS; ++l) {
        const state *b = s + loops[l].joint, *g = t + loops[l].joint;
        const vector x = feet[l].x, vx = add(b->v, cross(b->w, x));
        const vector dvx = add(g->v, add(cross(g->w, x), cross(b->w, feet[l].dx)));
        double *row = result + loops[l].row;
        rows_of_tangent(feet + l, loops[l].type, b->alpha, b->a, g->alpha, g->a, row);
        const vector turned = add(cross(g->w, vx), cross(b->w, dvx));
        OPERATIONS(3);
        row[0] += turned.x; row[1] += turned.y; row[2] += turned.z;
        if (loops[l].type) {
            const vector X = b->X, dX = cross(g->X, X), Xdot = cross(b->w, X), dXdot = add(cross(g->w, X), cross(b->w, dX));
            OPERATIONS(8);
            row[3] += g->w.z * Xdot.x - g->w.x * Xdot.z + b->w.z * dXdot.x - b->w.x * dXdot.z;
        }
    }
}

/* S from groups of rows: tile (g, h) = sum over joints of A_g B_h^T, from and to where both have entries. */
static void form_S(lane (*A)[8 * TILES], const lane *B, int B_step, int from_tip)
{
    for (int g = 0; g < GROUPS; ++g)
        for (int h = 0; h <= g; ++h) {
            const int begin = from_tip ? JOINTS - 1 - LAST(h) : 0, end = from_tip ? JOINTS : LAST(h) + 1;
            const int rows = ROWS - 8 * g < 8 ? ROWS - 8 * g : 8;
            const double *a = (const double *)A[g];
            const lane *b = B + (long)h * B_step;
            lane c[8] = {{0}};
            for (int i = begin; i < end; ++i)
                for (int r = 0; r < 8; ++r) c[r] += a[8 * i + r] * b[i];
            OPERATIONS(2.0 * (end - begin) * (g == h ? rows * (rows + 1) / 2 : 8 * rows));
            memcpy(TILE(S, g, h), c, sizeof c);
        }
    for (int r = ROWS; r < 8 * GROUPS; ++r) ((double *)(TILE(S, GROUPS - 1, GROUPS - 1)))[9 * (r % 8)] = 1;
    cholesky(S, GROUPS, ROWS, pivot_of_S);
}

#if !TREE
/* n and f of all joints as seen from joint i: M_ij = z_i . n_j + y_i . f_j, joints numbered from the tip. */
typedef struct { double nx[8 * TILES], ny[8 * TILES], nz[8 * TILES], fx[8 * TILES], fy[8 * TILES], fz[8 * TILES]; } columns;

static void spread(columns *c, int i, vector n, vector f)
{
    c->nx[i] = n.x; c->ny[i] = n.y; c->nz[i] = n.z;
    c->fx[i] = f.x; c->fy[i] = f.y; c->fz[i] = f.z;
}

static inline void row_of(const columns *c, int begin, int end, vector z, vector y, double *restrict row)
{
    for (int j = begin; j < end; ++j)
        row[j - begin] = z.x * c->nx[j] + z.y * c->ny[j] + z.z * c->nz[j] + y.x * c->fx[j] + y.y * c->fy[j] + y.z * c->fz[j];
}

/* M and K of the chain, Eq. 4; joints from the tip. */
static void form_M(double *K)
{
    static columns c;
    inertia all = {0};
    vector moment = {0, 0, 0}, force = {0, 0, 0};
    for (int k = JOINTS - 1; k >= 0; --k) {
        state *b = s + k;
        if (joints[k].rod) {
            const inertia I = about_origin(&b->body);
            const vector P = angular(&I, b->w, b->v), Q = linear(&I, b->w, b->v);
            moment = add(moment, add(angular(&I, b->alpha, b->a), add(cross(b->w, P), cross(b->v, Q))));
            force = add(force, add(linear(&I, b->alpha, b->a), cross(b->w, Q)));
            accumulate(&all, &I);
        }
        OPERATIONS(1);
        K[JOINTS - 1 - k] = -dot3(b->z, moment) - dot3(b->y, force);
        b->n = angular(&all, b->z, b->y);
        b->f = linear(&all, b->z, b->y);
        spread(&c, JOINTS - 1 - k, b->n, b->f);
    }
    OPERATIONS(11.0 * JOINTS * (JOINTS + 1) / 2);
    for (int i = 0; i < 8 * TILES; ++i)
        for (int h = 0; h <= i / 8; ++h) {
            double *row = (double *)(TILE(M, i / 8, h) + i % 8);
            if (i < JOINTS)
                row_of(&c, 8 * h, 8 * h + 8, s[JOINTS - 1 - i].z, s[JOINTS - 1 - i].y, row);
            else
                for (int j = 0; j < 8; ++j) row[j] = 8 * h + j == i;
        }
    cholesky(M, TILES, JOINTS, pivot_of_M);
}

/* dK - dM udot, joints from the tip, dM row by row (Eq. 9). */
static void right_side_tangent(const double *x, double *result)
{
    static columns c, dc;
    static double row[8 * TILES], other[8 * TILES];
    inertia all = {0}, dall = {0};
    vector moment = {0, 0, 0}, force = moment, dmoment = moment, dforce = moment;
    for (int k = JOINTS - 1; k >= 0; --k) {
        const state *b = s + k, *g = t + k;
        if (joints[k].rod) {
            const inertia I = about_origin(&b->body), dI = about_origin_tangent(&b->body, &g->body);
            const vector P = angular(&I, b->w, b->v), Q = linear(&I, b->w, b->v);
            const vector dP = add(angular(&dI, b->w, b->v), angular(&I, g->w, g->v));
            const vector dQ = add(linear(&dI, b->w, b->v), linear(&I, g->w, g->v));
            moment = add(moment, add(angular(&I, b->alpha, b->a), add(cross(b->w, P), cross(b->v, Q))));
            force = add(force, add(linear(&I, b->alpha, b->a), cross(b->w, Q)));
            dmoment = add(dmoment, add(add(angular(&dI, b->alpha, b->a), angular(&I, g->alpha, g->a)),
                                       add(add(cross(g->w, P), cross(b->w, dP)), add(cross(g->v, Q), cross(b->v, dQ)))));
            dforce = add(dforce, add(add(linear(&dI, b->alpha, b->a), linear(&I, g->alpha, g->a)),
                                     add(cross(g->w, Q), cross(b->w, dQ))));
            accumulate(&all, &I);
            accumulate(&dall, &dI);
        }
        OPERATIONS(3);
        result[JOINTS - 1 - k] = -(dot3(g->z, moment) + dot3(b->z, dmoment) + dot3(g->y, force) + dot3(b->y, dforce));
        spread(&c, JOINTS - 1 - k, b->n, b->f);
        spread(&dc, JOINTS - 1 - k, add(angular(&dall, b->z, b->y), angular(&all, g->z, g->y)),
               add(linear(&dall, b->z, b->y), linear(&all, g->z, g->y)));
    }
    OPERATIONS((23.0 + 4.0) * JOINTS * (JOINTS + 1) / 2);
    for (int i = 0; i < JOINTS; ++i) {
        const state *b = s + JOINTS - 1 - i, *g = t + JOINTS - 1 - i;
        const double xi = x[JOINTS - 1 - i];
        double whole = 0;
        row_of(&dc, 0, i + 1, b->z, b->y, row);
        row_of(&c, 0, i + 1, g->z, g->y, other);
        for (int j = 0; j <= i; ++j) row[j] += other[j];
        for (int j = 0; j <= i; ++j) whole += row[j] * x[JOINTS - 1 - j];
        for (int j = 0; j < i; ++j) result[j] -= row[j] * xi;
        result[i] -= whole;
    }
}

/* Eight columns of L^-1 B, from the first one that is not zero. */
static void lower_8(lane *B, int first)
{
    const double left = JOINTS - 8.0 * first;
    OPERATIONS(8 * left * left);
    for (int g = first; g < TILES; ++g) {
        lane c[8];
        const double *d = (const double *)TILE(M, g, g);
        memcpy(c, B + 8 * g, sizeof c);
        for (int k = first; k < g; ++k) subtract(c, (const double *)TILE(M, g, k), B + 8 * k);
        for (int r = 0; r < 8; ++r) {
            for (int j = 0; j < r; ++j) c[r] -= d[8 * r + j] * c[j];
            c[r] *= pivot_of_M[8 * g + r];
        }
        memcpy(B + 8 * g, c, sizeof c);
    }
}

static void turn_round(const double *x, double *result)
{
    for (int i = 0; i < JOINTS; ++i) result[i] = x[JOINTS - 1 - i];
}
#endif

/* --- all together --- */

/* x = M^-1 x */
static void solve_M(double *x)
{
#if TREE
    static double b[JOINTS];
    memcpy(b, x, sizeof b);
    tree_solve_1(b, x, work);
#else
    static lane b[TILES];
    turn_round(x, (double *)b);
    solve(M, TILES, JOINTS, pivot_of_M, (double *)b);
    turn_round((const double *)b, x);
#endif
}

/* Returns what J, and with `directions` dJ, do with x: for making consistent seeds. */
void times_rows(const double *q, const double *u, const double *p, const double *dq, const double *du, const double *dp,
                const double *x, int tangent, double *result)
{
    outward(q, u, p[0]);
    find_feet(p[0]);
    outward_tangent(q, u, p[0], dq, du, dp[0]);
    find_feet_tangent(p[0], dp[0]);
    times_J(x, result, tangent);
}

int constrained(int directions, const double *q, const double *u, const double *p, const double *dq, const double *du,
                const double *dp, double *udot, double *dudot, double *counted)
{
    static double lambda[8 * GROUPS], force[JOINTS];
    static lane right[GROUPS];
    double *const side = (double *)right;
    const double L = p[0];
#ifdef COUNT
    operations = 0;
#endif
    outward(q, u, L);
    find_feet(L);
    jacobian();
    bias(lambda);
#if TREE
    if (tree_forward(q, u, p, udot, work)) return 1;
    for (int g = 0; g < GROUPS; ++g) tree_solve_8((const double *)JT[g], (double *)X[g], work);
    form_S(X, JT[0], JOINTS, 0);
#else
    form_M(force);
    for (int g = 0; g < GROUPS; ++g) {
        const int first = (JOINTS - 1 - LAST(g)) / 8;
        for (int i = 8 * first; i < JOINTS; ++i) X[g][i] = JT[g][JOINTS - 1 - i];
        lower_8(X[g], first);
    }
    form_S(X, X[0], 8 * TILES, 1);
    turn_round(force, udot);
    solve_M(udot);
#endif
    /* S lambda = -(b + J M^-1 K); udot = M^-1 K + M^-1 J^T lambda */
    memset(right, 0, sizeof right);
    times_J(udot, side, 0);
    OPERATIONS(ROWS);
    for (int i = 0; i < ROWS; ++i) side[i] = -lambda[i] - side[i];
    solve(S, GROUPS, ROWS, pivot_of_S, side);
    memcpy(lambda, side, sizeof lambda);
    times_JT(lambda, force, 0);
    solve_M(force);
    OPERATIONS(JOINTS);
    for (int i = 0; i < JOINTS; ++i) udot[i] += force[i];

    if (directions) {
        static double other[8 * GROUPS];
        outward_tangent(q, u, L, dq, du, dp[0]);
        find_feet_tangent(L, dp[0]);
        times_JT(lambda, dudot, 1);
#if TREE
        static double needed[JOINTS];
        tree_force_tangent(udot, dq, du, dp, needed, force, work);
        for (int i = 0; i < JOINTS; ++i) dudot[i] -= force[i];
#else
        static double turned[8 * TILES];
        right_side_tangent(udot, turned);
        for (int i = 0; i < JOINTS; ++i) dudot[i] += turned[JOINTS - 1 - i];
#endif
        OPERATIONS(JOINTS);
        solve_M(dudot);
        bias_tangent(other);
        times_J(udot, side, 1);
        for (int i = 0; i < ROWS; ++i) other[i] += side[i];
        times_J(dudot, side, 0);
        OPERATIONS(2 * ROWS);
        for (int i = 0; i < ROWS; ++i) side[i] = -other[i] - side[i];
        solve(S, GROUPS, ROWS, pivot_of_S, side);
        times_JT(side, force, 0);
        solve_M(force);
        OPERATIONS(JOINTS);
        for (int i = 0; i < JOINTS; ++i) dudot[i] += force[i];
    }
#ifdef COUNT
    *counted = operations;
#else
    (void)counted;
#endif
    return 0;
}
