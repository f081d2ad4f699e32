from codegen.model import *
