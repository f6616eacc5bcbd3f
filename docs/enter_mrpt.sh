#!/bin/sh
# MRPT's icp-slam on the CARMEN logs of a suite: sh enter_mrpt.sh DIR; writes answers.zip. Needs mrpt-apps and zip.
set -e
config=/usr/share/mrpt/config_files/icp-slam/icp-slam_demo_classic.ini
for log in "$1"/*-[0-9]/*-[0-9].log; do
  name=$(basename "$log" .log); rm -rf "work/$name"; mkdir -p "work/$name"
  carmen2rawlog -i "$log" -o "work/$name/a.rawlog" -q
  (cd "work/$name" && icp-slam "$config" a.rawlog > icp.txt)
  awk '{print}' "work/$name"/LOG_ICP-SLAM/*.tum > "$name.tum"
done
zip -q answers.zip ./*.tum
