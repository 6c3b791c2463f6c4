from .study import Study as Study
from .study import json_schema as json_schema
