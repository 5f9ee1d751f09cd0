"""Complementarity problems, the methods that solve them, the judge of the answer, its derivative. No mechanics."""

from jaxcontact.complementarity.banach import Banach as Banach
from jaxcontact.complementarity.banach import contraction_rate as contraction_rate
from jaxcontact.complementarity.conversions import ave_as_horizontal as ave_as_horizontal
from jaxcontact.complementarity.conversions import ave_as_lcp as ave_as_lcp
from jaxcontact.complementarity.conversions import horizontal_as_ave as horizontal_as_ave
from jaxcontact.complementarity.conversions import horizontal_as_lcp as horizontal_as_lcp
from jaxcontact.complementarity.conversions import lcp_as_ave as lcp_as_ave
from jaxcontact.complementarity.conversions import lcp_as_horizontal as lcp_as_horizontal
from jaxcontact.complementarity.conversions import mlcp_as_lcp as mlcp_as_lcp
from jaxcontact.complementarity.derivative import implicit as implicit
from jaxcontact.complementarity.direct import Direct as Direct
from jaxcontact.complementarity.enumeration import AllSolutions as AllSolutions
from jaxcontact.complementarity.enumeration import all_solutions as all_solutions
from jaxcontact.complementarity.gauss_seidel import ProjectedGaussSeidel as ProjectedGaussSeidel
from jaxcontact.complementarity.judge import Claim as Claim
from jaxcontact.complementarity.judge import judge as judge
from jaxcontact.complementarity.lemke import Lemke as Lemke
from jaxcontact.complementarity.method import Answer as Answer
from jaxcontact.complementarity.method import Method as Method
from jaxcontact.complementarity.problems import LCP as LCP
from jaxcontact.complementarity.problems import MLCP as MLCP
from jaxcontact.complementarity.problems import AbsoluteValueEquation as AbsoluteValueEquation
from jaxcontact.complementarity.problems import HorizontalLCP as HorizontalLCP
from jaxcontact.complementarity.solution import Solution as Solution
from jaxcontact.complementarity.solve import solve as solve
from jaxcontact.complementarity.status import Status as Status
