from codegen.loops import *
