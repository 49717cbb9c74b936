#!/bin/bash
# The step of action.yml: unpacks Tuff and lets the steps that follow use it.
#
#   FROM      a tarball, or the folder that one was unpacked to; or else
#   VERSION   a release below the address RELEASES, and
#   SHA256    the sum that its tarball must have; empty: the sum in the release's SHA256SUMS
#
# RUNNER_TEMP, GITHUB_ENV, GITHUB_PATH and GITHUB_OUTPUT are the runner's.
set -euo pipefail

fail() {
    echo "::error title=Tuff::$1"
    exit 1
}

folder=$RUNNER_TEMP/tuff
if [ -d "${FROM:-}" ]; then
    prefix=$(cd "$FROM" && pwd)
else
    if [ -n "${FROM:-}" ]; then
        tarball=$FROM
        [ -f "$tarball" ] || fail "there is no $tarball"
    else
        [ -n "${VERSION:-}" ] || fail "give a version or a path"
        name=tuff-vulkan-$VERSION-linux-$(uname -m).tar.gz
        tarball=$RUNNER_TEMP/$name
        fetch() {
            curl --fail --silent --show-error --location --retry 3 --output "$2" "$RELEASES/v$VERSION/$1" ||
                fail "$RELEASES/v$VERSION/$1 could not be downloaded: is there such a release for this processor?"
        }
        fetch "$name" "$tarball"
        sum=${SHA256:-}
        if [ -z "$sum" ]; then
            fetch SHA256SUMS "$RUNNER_TEMP/SHA256SUMS"
            sum=$(awk -v name="$name" '$2 == name { print $1 }' "$RUNNER_TEMP/SHA256SUMS")
        fi
        echo "$sum  $tarball" | sha256sum --check --quiet || fail "$name is not what its sum says"
    fi
    rm -rf "$folder"
    mkdir -p "$folder"
    tar --extract --file "$tarball" --directory "$folder" --strip-components 1
    prefix=$folder
fi

manifest=$prefix/share/vulkan/icd.d/tuff_icd.json
[ -f "$manifest" ] || fail "$prefix has no share/vulkan/icd.d/tuff_icd.json: it is no folder of Tuff"
# The program knows which variables this machine needs: those that it prints are what the next steps get.
unset VK_DRIVER_FILES VK_ICD_FILENAMES
before=${LD_LIBRARY_PATH:-}
eval "$("$prefix/bin/tuff" env)"
{
    echo "VK_DRIVER_FILES=$VK_DRIVER_FILES"
    echo "VK_ICD_FILENAMES=$VK_ICD_FILENAMES"
    if [ "${LD_LIBRARY_PATH:-}" != "$before" ]; then
        echo "LD_LIBRARY_PATH=$LD_LIBRARY_PATH"
    fi
} >>"$GITHUB_ENV"
echo "$prefix/bin" >>"$GITHUB_PATH"
echo "manifest=$manifest" >>"$GITHUB_OUTPUT"
