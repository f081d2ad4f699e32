from codegen.program import *
