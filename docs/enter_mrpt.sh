#!/bin/sh
# sh docs/enter_mrpt.sh DIR: MRPT's icp-slam (Debian's mrpt-apps) on the CARMEN logs of a suite, as answers.zip
here=$(cd "$(dirname "$0")" && pwd); mkdir answers || exit 1
for log in "$1"/*/*-[0-9]*.log; do
  case $log in *.usarsim.log) continue ;; esac
  name=$(basename "$log" .log); work=$(mktemp -d)
  awk -f "$here/enter_mrpt.awk" "$log" > "$work/a.log"                     # MRPT 2.5.8 reads stamps 10¹² times too small
  carmen2rawlog -q -i "$work/a.log" -o "$work/a.rawlog" > "$work/told.txt" || continue
  (cd "$work" && icp-slam "$here/enter_mrpt.ini" a.rawlog < /dev/null >> told.txt)
  awk -f "$here/enter_mrpt.awk" "$work/LOG/log_estimated_path.txt" "$log" > "answers/$name.tum"
done
zip -qr answers.zip answers
