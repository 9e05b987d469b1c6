"""Problem, tables and true values → the measurements that the model predicts there, with noise of the stated size."""
