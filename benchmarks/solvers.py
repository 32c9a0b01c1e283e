"""The way to a steady state by this solver, by scipy's and by py-pde, at what error.

The job is the preset `makse-profile`, from its start to its end, where the closed form of the paper's
section III holds. The others solve the same equations, method of lines on the same cells, without a
deposit, for nothing is eroded here:

    dR_a/dt = - v (R_a - R_a,uphill) / dx + Gamma_a        dh/dt = - sum_a Gamma_a
    dm_a/dt = - Gamma_a - phi_a max(-sum_b Gamma_b, 0)      phi_a = (m_a + bare_a) / d

with all that reaches the last cell captured there. Upwind differences of first order serve them best:
they cannot oscillate, and are the spatial accuracy of this solver's exchange. Errors are mean
absolute ones away from the wall, as in the tests: of theta at the cells' downhill edges, and of R_a
[% of R0] where each scheme defines it.
"""
