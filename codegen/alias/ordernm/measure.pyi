from codegen.measure import *
