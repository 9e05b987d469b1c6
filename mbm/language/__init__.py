"""Forms become values here: the bounded, pure evaluator of LANGUAGE §1–2 and the vocabulary of §6."""
