from .study import Study as Study
from .study import json_schema as json_schema
from .study import load_study as load_study
from .study import parse_study as parse_study
