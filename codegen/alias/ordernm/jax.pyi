from codegen.jax import *
