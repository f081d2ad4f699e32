from codegen.symbolic import *
