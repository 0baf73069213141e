"""Verdicts on an iteration of Newton's method, which the rules of both engines return.

Given steps cannot be rejected. Their rule (`verdict` in given/newton.py) spends more iterations and
Jacobians before it fails, and may begin again at the first guess. A step of collocation that fails
is rejected and made shorter, so its rule (`verdict` in collocation/newton.py) fails earlier. It
also has an estimated rate for the first correction.
"""

ACCEPT = 0  # the solution is accurate enough
ITERATE = 1  # iterate again with the same Jacobian
CHECK = 2  # compare the next residual with its rounding errors
REFRESH = 3  # compute the Jacobian again, at the present iterate
RESTART = 4  # return to the first guess, and compute the Jacobian again
FAIL = 5  # the step is not solved
