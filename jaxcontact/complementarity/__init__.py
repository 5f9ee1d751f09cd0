"""Complementarity problems, the methods that solve them, the judge of the answer, its derivative. Knows no mechanics."""

from jaxcontact.complementarity.derivative import implicit as implicit
from jaxcontact.complementarity.judge import judge as judge
from jaxcontact.complementarity.lemke import Lemke as Lemke
from jaxcontact.complementarity.problems import LCP as LCP
from jaxcontact.complementarity.problems import MLCP as MLCP
from jaxcontact.complementarity.problems import AbsoluteValueEquation as AbsoluteValueEquation
from jaxcontact.complementarity.problems import HorizontalLCP as HorizontalLCP
from jaxcontact.complementarity.solution import Solution as Solution
from jaxcontact.complementarity.solve import solve as solve
from jaxcontact.complementarity.status import Status as Status
