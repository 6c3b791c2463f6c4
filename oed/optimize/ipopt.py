"""Search by Ipopt from many starts and perturbed designs, with a second stage among equal optima."""

from __future__ import annotations

from oed.kernel.problem import Problem
from oed.kernel.solution import Solution
from oed.optimize.ipopt_options import IpoptOptions
from oed.optimize.search import IpoptSearch
from oed.optimize.solver import Context


class Ipopt(IpoptOptions):
    """Multi-start interior-point search with exact Hessians.

    Attributes:
        starts: number of starts, half of them screened random drives, half small random coefficients; or
            "auto" for as many local searches, from varied starts and perturbed designs, as `iterations`
            allow.
        perturbations: number of further searches from perturbed copies of the best design; not for "auto".
        iterations: budget of "auto" in iterations of Ipopt on 200 samples; an iteration on n samples (of all
            runs and robots) counts n/200. The search ends sooner where it finds the best design repeatedly.
            By default 1200, shared equally by all searches of a study that do not set it.
        second_stage: criterion among designs of practically equal objective: "logdet" (most information in
            all directions), "shortest_path", or "none", which keeps the full objective.
        second_stage_share: share of the best objective that the second stage has to keep.
        start_from: name of an earlier search of the study whose design replaces the first start.
        search_samples: samples per run on the grid of the search, which is corrected to agree with all of
            them; by default all samples up to the larger of 600 and 18 per spline coefficient, else about the
            larger of 400 and 12 per coefficient.
        max_iterations: largest number of iterations of a local search.
        tolerance: tolerance of Ipopt in a local search.
        time_limit: largest duration of the search [s]; None for no limit. The result of a search that it ends
            depends on the machine.
    """

    def search(self, problem: Problem, context: Context) -> Solution:
        """Return the best design of all starts; of an interrupted search, the best so far."""
        return IpoptSearch(self, problem, context).run()
