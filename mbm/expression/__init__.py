"""The typed expression DAG that every number-like value is made of: scalars with dimension, span, and angle-ness."""
