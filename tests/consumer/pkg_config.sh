#!/usr/bin/env bash
# pkg_config.sh PREFIX CXX OUT EXAMPLE: a program compiles, links and solves with the flags that pkg-config names.
set -euo pipefail
prefix=$1 compiler=$2 out=$3 example=$4
command -v pkg-config >/dev/null || { echo "consumer.pkg_config: skipped, no pkg-config"; exit 77; }
file=$(find "$prefix" -name bromwich.pc)
export PKG_CONFIG_PATH=${file%/*}
read -ra flags < <(pkg-config --cflags --libs bromwich)
mkdir -p "$out"
"$compiler" -std=c++20 "$example" -o "$out/program" "${flags[@]}"
"$out/program"
