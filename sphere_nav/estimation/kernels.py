"""Constants of robust statistics that compiled code uses, too."""

SIGMA_OF_MAD = 1.4826  # 1 / Phi^-1(0.75), normal distribution (M15 eq. 35)
