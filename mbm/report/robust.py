"""What an explanation says about outliers: the loss of a clause, and how agreement is found."""

from __future__ import annotations

from mbm.problem.types import Consensus, ConsensusKind, Loss

_METHODS = {
    ConsensusKind.LMEDS: "least median of squares",
    ConsensusKind.RANSAC: "RANSAC: as many measurements as possible",
    ConsensusKind.MSAC: "MSAC: as many measurements as possible, and those close",
    ConsensusKind.GNC: "graduated non-convexity",
}


def loss_text(loss: Loss) -> str:
    """The loss with its parameters."""
    shape = "" if loss.shape is None else f" with exponent {loss.shape:g}"
    scale = "its parameter for 95 % efficiency" if loss.scale is None else f"beyond {loss.scale:g} standard deviations"
    return f"{loss.kind.value}{shape}, {scale}"


def consensus_text(consensus: Consensus) -> str:
    """How the measurements that agree are found."""
    trials = "" if consensus.trials is None else f", {consensus.trials} trials"
    limit = "" if consensus.threshold is None else f", within {consensus.threshold:g} standard deviations"
    return f"{_METHODS[consensus.kind]}{trials}{limit}; then a fit to the measurements that agree"
