from codegen.bench import *
