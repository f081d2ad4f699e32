from codegen.reporting import *
