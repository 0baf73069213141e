"""Memory kernels K(t) beyond the power law, for terms ``int_0^t K(t-s) y^(m)(s) ds``.

Each kernel has values, an integral from 0 with full precision at any t, and the exponent of its
singularity at 0. It also has a sum of exponentials. All kernels that are not signed are completely
monotone: superpositions of decaying exponentials with positive weights. This keeps the memory
stable.
"""
