from codegen.casadi import *
