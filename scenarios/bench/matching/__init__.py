"""Scan matchers side by side: pairs of scans whose relative pose is known, scores, peers, and the bound."""
