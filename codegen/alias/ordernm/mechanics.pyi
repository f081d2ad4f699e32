from codegen.mechanics import *
