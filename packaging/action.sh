#!/bin/bash
# The step of action.yml: unpacks Tuff and lets the steps that follow use it.
#
#   FROM      a tarball (on Windows a zip), or the folder that one was unpacked to; or else
#   VERSION   a release below the address RELEASES, and
#   SHA256    the sum that its tarball must have; empty: the sum in the release's SHA256SUMS
#
# On Windows the shell is that of Git, and the driver is registered, too: the runner's programs are
# an administrator's, in which the loader ignores variables.
#
# RUNNER_TEMP, GITHUB_ENV, GITHUB_PATH and GITHUB_OUTPUT are the runner's.
set -euo pipefail

fail() {
    echo "::error title=Tuff::$1"
    exit 1
}

case $(uname -s) in
MINGW* | MSYS* | CYGWIN*)
    windows=yes system=windows ending=zip exe=.exe
    native() { cygpath --windows "$1"; }
    RUNNER_TEMP=$(cygpath --unix "$RUNNER_TEMP")
    ;;
*)
    windows='' system=linux ending=tar.gz exe=''
    native() { echo "$1"; }
    ;;
esac

folder=$RUNNER_TEMP/tuff
if [ -d "${FROM:-}" ]; then
    prefix=$(cd "$FROM" && pwd)
else
    if [ -n "${FROM:-}" ]; then
        tarball=$FROM
        [ -f "$tarball" ] || fail "there is no $tarball"
    else
        [ -n "${VERSION:-}" ] || fail "give a version or a path"
        name=tuff-vulkan-$VERSION-$system-$(uname -m).$ending
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
    if [ -n "$windows" ]; then
        unzip -q "$tarball" -d "$folder" || fail "$tarball is no zip of Tuff"
        set -- "$folder"/*
        prefix=$1
    else
        tar --extract --file "$tarball" --directory "$folder" --strip-components 1
        prefix=$folder
    fi
fi

manifest=$prefix/share/vulkan/icd.d/tuff_icd.json
[ -f "$manifest" ] || fail "$prefix has no share/vulkan/icd.d/tuff_icd.json: it is no folder of Tuff"
# The program knows which variables this machine needs: those that it prints are what the next steps get.
unset VK_DRIVER_FILES VK_ICD_FILENAMES
libraries=LD_LIBRARY_PATH
[ -z "$windows" ] || libraries=PATH
before=${!libraries:-}
lines=$("$prefix/bin/tuff$exe" env --shell sh)
eval "$lines"
{
    echo "VK_DRIVER_FILES=$VK_DRIVER_FILES"
    echo "VK_ICD_FILENAMES=$VK_ICD_FILENAMES"
    if [ -z "$windows" ] && [ "${LD_LIBRARY_PATH:-}" != "$before" ]; then
        echo "LD_LIBRARY_PATH=$LD_LIBRARY_PATH"
    fi
} >>"$GITHUB_ENV"
if [ -n "$windows" ]; then
    # Where the image has no loader.
    [ "$PATH" = "$before" ] || native "$prefix/lib/tuff/loader" >>"$GITHUB_PATH"
    "$prefix/bin/tuff$exe" install
fi
native "$prefix/bin" >>"$GITHUB_PATH"
echo "manifest=$(native "$manifest")" >>"$GITHUB_OUTPUT"
