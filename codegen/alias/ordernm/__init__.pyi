from codegen import *
from codegen import __version__ as __version__
