/* The scalar type of motions: the one place in the integrators that names it, as FLOAT64 of codegen/emit/c/types.py does. */
#ifndef ORDERNM_SCALAR_H
#define ORDERNM_SCALAR_H

typedef double ordernm_scalar;

#endif
