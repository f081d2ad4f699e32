from codegen.emit import *
