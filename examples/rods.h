/* Rods in the ground's components, about the ground's origin: what the dense methods of the paper's examples are made of. */
#include <math.h>
#include <string.h>

#define RADIUS 0.05
#define GRAVITY 9.81

/* Additions and multiplications are counted where COUNT is defined; elsewhere this costs nothing. */
#ifdef COUNT
static double operations;
#define OPERATIONS(k) (operations += (k))
#else
#define OPERATIONS(k) ((void)0)
#endif

typedef struct { double x, y, z; } vector;

static inline vector cross(vector a, vector b)
{
    OPERATIONS(9);
    return (vector){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
static inline double dot3(vector a, vector b)
{
    OPERATIONS(5);
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
static inline vector add(vector a, vector b)
{
    OPERATIONS(3);
    return (vector){a.x + b.x, a.y + b.y, a.z + b.z};
}
static inline vector sub(vector a, vector b)
{
    OPERATIONS(3);
    return (vector){a.x - b.x, a.y - b.y, a.z - b.z};
}
static inline vector mul(double s, vector a)
{
    OPERATIONS(3);
    return (vector){s * a.x, s * a.y, s * a.z};
}

/* A moving body: inertia of a body of revolution about its centre c: a (U - e e^T) + b e e^T. */
typedef struct { vector e, c; double m, a, b; } rod;

/* Inertia about the origin: mass, first moment, J (xx yy zz xy xz yz). */
typedef struct { double m; vector h; double J[6]; } inertia;

static inline vector times(const double *J, vector w)
{
    OPERATIONS(15);
    return (vector){J[0] * w.x + J[3] * w.y + J[4] * w.z, J[3] * w.x + J[1] * w.y + J[5] * w.z,
                    J[4] * w.x + J[5] * w.y + J[2] * w.z};
}

static inline inertia about_origin(const rod *r)
{
    const vector e = r->e, c = r->c;
    const double m = r->m, s = r->a + m * dot3(c, c), t = r->b - r->a;
    OPERATIONS(3 + 36);
    return (inertia){m, mul(m, c), {
        s + t * e.x * e.x - m * c.x * c.x, s + t * e.y * e.y - m * c.y * c.y, s + t * e.z * e.z - m * c.z * c.z,
        t * e.x * e.y - m * c.x * c.y, t * e.x * e.z - m * c.x * c.z, t * e.y * e.z - m * c.y * c.z}};
}

static inline inertia about_origin_tangent(const rod *r, const rod *d)
{
    const vector e = r->e, c = r->c, de = d->e, dc = d->c;
    const double m = r->m, dm = d->m, t = r->b - r->a, dt = d->b - d->a;
    const double ds = d->a + dm * dot3(c, c) + 2 * m * dot3(c, dc);
    const vector p = add(mul(dt, e), mul(t, de)), h = add(mul(dm, c), mul(m, dc));
    OPERATIONS(7 + 63);
    return (inertia){dm, h, {
        ds + p.x * e.x + t * e.x * de.x - h.x * c.x - m * c.x * dc.x,
        ds + p.y * e.y + t * e.y * de.y - h.y * c.y - m * c.y * dc.y,
        ds + p.z * e.z + t * e.z * de.z - h.z * c.z - m * c.z * dc.z,
        p.x * e.y + t * e.x * de.y - h.x * c.y - m * c.x * dc.y,
        p.x * e.z + t * e.x * de.z - h.x * c.z - m * c.x * dc.z,
        p.y * e.z + t * e.y * de.z - h.y * c.z - m * c.y * dc.z}};
}

/* Momentum of an inertia with the velocity (w, v) of the origin's material point: moment and force parts. */
static inline vector angular(const inertia *I, vector w, vector v) { return add(times(I->J, w), cross(I->h, v)); }
static inline vector linear(const inertia *I, vector w, vector v) { return add(mul(I->m, v), cross(w, I->h)); }

static inline void accumulate(inertia *sum, const inertia *I)
{
    OPERATIONS(7);
    sum->m += I->m;
    sum->h = add(sum->h, I->h);
    for (int i = 0; i < 6; ++i) sum->J[i] += I->J[i];
}
