from codegen.design import *
