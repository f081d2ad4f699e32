from codegen.torch import *
