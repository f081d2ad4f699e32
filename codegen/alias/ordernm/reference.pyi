from codegen.reference import *
