"""The exact disk solver of any mesh as one differentiable operation: what DBS-Net stands in for."""

import torch


class ExactSolve(torch.autograd.Function):
    """f (V,) from mu (F,) by a `BeltramiDiskSolver`, backward by its adjoint; one factorisation for both ways.

    float64 inside, in the precision and on the device of mu outside. The solver keeps the last factorisation only: the
    backward pass of a solve before the last one factors once more.
    """

    @staticmethod
    def forward(ctx, mu, solver):
        ctx.solver, ctx.mu = solver, mu.detach().cpu().numpy()
        return torch.from_numpy(solver.solve(ctx.mu)).to(mu)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad_f):
        if ctx.solver.mu is not ctx.mu and not (ctx.solver.mu == ctx.mu).all():
            ctx.solver.solve(ctx.mu)
        return torch.from_numpy(ctx.solver.pullback(grad_f.cpu().numpy())).to(grad_f), None


def exact_solve(solver, mu):
    """The maps f (B, V) or (V,) of mu (B, F) or (F,) by a `BeltramiDiskSolver`, differentiable; errors as its own."""
    if mu.ndim == 1:
        return ExactSolve.apply(mu, solver)
    return torch.stack([ExactSolve.apply(one, solver) for one in mu])
