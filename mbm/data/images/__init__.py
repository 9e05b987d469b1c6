"""Makes measured points from photographs: decoding within bounds, boards, sub-pixel fits with their covariances."""
