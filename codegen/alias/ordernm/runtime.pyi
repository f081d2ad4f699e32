from codegen.runtime import *
