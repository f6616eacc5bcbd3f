# Two files: a path of icp-slam, a row for each entry of the rawlog, and the log → a TUM line for each scan.
# One file: the log with its stamps as carmen2rawlog of MRPT 2.5.8 reads them rightly.
BEGIN { CONVFMT = "%.0f" }
ARGC == 2 { if (/^(ROBOTLASER1|ODOM)/) { $(NF - 2) *= 1e12; $NF *= 1e12 } print; next }
FNR == NR { x[FNR] = $2; y[FNR] = $3; half[FNR] = $4 / 2; next }
/^ODOM/ { row++ }
/^ROBOTLASER1/ { row += 2; printf "%s %s %s 0 0 0 %.9f %.9f\n", $NF, x[row], y[row], sin(half[row]), cos(half[row]) }
