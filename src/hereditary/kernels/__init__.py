"""Memory kernels K(t) beyond the power law, for terms ``int_0^t K(t-s) y^(m)(s) ds``.

Each has its values, and its integral from 0 to full precision however small t is. It has its
singular exponent at 0, and its sum of exponentials. All but signed ones are completely monotone:
superpositions of decaying exponentials with positive weights, which is what keeps a memory stable.
"""
