from codegen.importing import *
