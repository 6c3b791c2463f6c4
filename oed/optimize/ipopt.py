"""Search by Ipopt: from many starts, perturbed and solved again, with a second stage among equal optima."""

from __future__ import annotations

from oed.kernel.problem import Problem
from oed.kernel.solution import Solution
from oed.optimize.ipopt_options import IpoptOptions
from oed.optimize.search import Search
from oed.optimize.solver import Context


class Ipopt(IpoptOptions):
    """Multi-start interior-point search with exact Hessians.

    Attributes:
        starts: "auto" for as many local searches, from varied starts and perturbed designs, as `iterations`
            allow; or their number, half from screened random drives, half from small random coefficients.
        perturbations: with a number of starts, further searches from perturbed copies of the best design.
        iterations: budget of "auto": Ipopt's iterations on 200 samples; one on n samples (of all runs and
            robots) counts n/200. It ends sooner where the best is found again and again. By default 1200,
            of which the searches of one study that leave it out have equal shares.
        second_stage: what decides among designs of practically equal objective: "logdet" (most
            information in all directions), "shortest_path", or "none", which gives nothing of the objective
            away.
        second_stage_share: share of the best objective that the second stage has to keep.
        start_from: name of an earlier search of the study whose design takes the place of the first start.
        search_samples: samples per run that searches look at, corrected to agree with all of them; by
            default all up to 400, else at most 400 or 12 per spline coefficient.
        max_iterations, tolerance: of Ipopt, per local search.
        time_limit: of the whole search [s]; None for none. A search that it ends depends on the machine.
    """

    def search(self, problem: Problem, context: Context) -> Solution:
        """Return the best design of all starts; of an interrupted search, the best so far."""
        return Search(self, problem, context).run()
