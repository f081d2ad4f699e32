from codegen.exporting import *
