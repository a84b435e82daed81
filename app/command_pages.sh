#!/usr/bin/env bash
# command_pages.sh BROMWICH OUT [HELP2MAN]: manual pages and completions for bash and zsh, made from what the command says
# of itself, so that a new option is in all of them:
#
#     OUT/man1/bromwich.1, bromwich-COMMAND.1   by help2man, where it is installed
#     OUT/bash/bromwich, OUT/zsh/_bromwich
set -euo pipefail
bromwich=$(realpath "$1") out=$2 help2man=${3-}
rm -rf "$out"
mkdir -p "$out/bash" "$out/zsh" "$out/man1"
out=$(realpath "$out")

# The rows of a section of a help text, "NAME<tab>DESCRIPTION".
section() { awk -v title="$2:" '$0 == title { on = 1; next } /^[^ ]/ || /^$/ { on = 0 } on && /^  [^ ]/' <<<"$1" | sed -E 's/^  //; s/  +/\t/'; }
commands=$(section "$("$bromwich" --help)" Subcommands)

# The options of a command: name, argument, description, values, with \037 between them. The values are those of a NAME,
# which the description begins with: "euler (default), midpoint or exponential".
options() {
  section "$("$bromwich" $1 --help)" Options | awk -F'\t' -v OFS='\037' '{
    split($1, words, " "); count = split(words[1], names, ","); values = ""
    if (words[2] == "NAME") {
      text = $2; sub(/^method [a-z]+: /, "", text); sub(/;.*/, "", text); gsub(/ \(default\)/, "", text); gsub(/ or /, ", ", text)
      many = split(text, parts, /, */)
      for (i = 1; i <= many; ++i) { sub(/[ :].*/, "", parts[i]); values = values (i > 1 ? " " : "") parts[i] }
    }
    for (i = 1; i <= count; ++i) print names[i], words[2], $2, values
  }'
}

option_names() { options "$1" | cut -d$'\037' -f1; }

benchmarks=$(section "$("$bromwich" bench --help)" Benchmarks | cut -f1 | tr '\n' ' ')

write_bash() {
  cat <<'END'
# Completion of bromwich for bash; made by app/command_pages.sh.
# Names of the parameters of the scene on the line; those of a file with T and steps.
_bromwich_parameters() {
  local word scene= more=
  for word in "${COMP_WORDS[@]:2:COMP_CWORD-2}"; do
    if [[ $word != -* && -z $scene ]]; then scene=$word; fi
  done
  [[ $scene != *.toml ]] || more="T steps"
  compopt -o nospace 2>/dev/null
  COMPREPLY=($(compgen -S = -W "$(bromwich scenes "$scene" 2>/dev/null | grep -o '^[A-Za-z_][A-Za-z0-9_]*=' | tr -d =) $more" -- "$1"))
}
_bromwich() {
  local cur=${COMP_WORDS[COMP_CWORD]} prev=${COMP_WORDS[COMP_CWORD - 1]} command= word
  for word in "${COMP_WORDS[@]:1:COMP_CWORD-1}"; do
    if [[ $word != -* ]]; then command=$word; break; fi
  done
  COMPREPLY=()
  case $command,$prev in
END
  while IFS=$'\t' read -r command _; do
    while IFS=$'\037' read -r name argument _ values; do
      if [[ $name == --set ]]; then
        printf '    %s,--set) _bromwich_parameters "$cur"; return ;;\n' "$command"
      elif [[ -n $values ]]; then
        printf '    %s,%s) COMPREPLY=($(compgen -W "%s" -- "$cur")); return ;;\n' "$command" "$name" "$values"
      elif [[ $argument == *FILE* ]]; then
        printf '    %s,%s) COMPREPLY=($(compgen -f -- "$cur")); return ;;\n' "$command" "$name"
      elif [[ -n $argument ]]; then
        printf '    %s,%s) return ;;\n' "$command" "$name"
      fi
    done < <(options "$command")
  done <<<"$commands"
  printf '  esac\n  case $command in\n'
  printf '    "") COMPREPLY=($(compgen -W "%s %s" -- "$cur")) ;;\n' "$(cut -f1 <<<"$commands" | tr '\n' ' ')" "$(option_names '' | tr '\n' ' ')"
  while IFS=$'\t' read -r command _; do
    printf '    %s)\n      if [[ $cur == -* ]]; then COMPREPLY=($(compgen -W "%s" -- "$cur"))\n' "$command" "$(option_names "$command" | tr '\n' ' ')"
    [[ $command != bench ]] || printf '      elif [[ $prev == bench ]]; then COMPREPLY=($(compgen -W "%s" -- "$cur"))\n' "$benchmarks"
    [[ $command != solve ]] || printf '      elif [[ $cur != */* ]]; then COMPREPLY=($(compgen -W "$(bromwich scenes 2>/dev/null | cut -d" " -f1 | grep -v "^FILE")" -- "$cur") $(compgen -f -- "$cur"))\n'
    printf '      else COMPREPLY=($(compgen -f -- "$cur"))\n      fi ;;\n'
  done <<<"$commands"
  printf '  esac\n}\ncomplete -o filenames -F _bromwich bromwich\n'
}

# What zsh shows in brackets, without the signs that end it.
plain() { sed -e "s/'/’/g; s/\[/(/g; s/\]/)/g; s/:/;/g" <<<"$1"; }

write_zsh() {
  cat <<'END'
#compdef bromwich
# Completion of bromwich for zsh; made by app/command_pages.sh.
# Names of the parameters of the scene on the line; those of a file with T and steps.
_bromwich_parameters() {
  local word scene=
  local -a names
  for word in $words[2,CURRENT-1]; do
    if [[ $word != -* && $word != *=* && -z $scene ]]; then scene=$word; fi
  done
  names=(${(f)"$(bromwich scenes "$scene" 2>/dev/null | grep -o '^[A-Za-z_][A-Za-z0-9_]*=' | tr -d =)"})
  [[ $scene != *.toml ]] || names+=(T steps)
  compadd -S = -- $names
}
_bromwich() {
  local -a commands
  commands=(
END
  while IFS=$'\t' read -r command text; do printf "    '%s:%s'\n" "$command" "$(plain "$text")"; done <<<"$commands"
  printf '  )\n  if ((CURRENT == 2)); then\n    _describe command commands\n    _arguments'
  while IFS=$'\037' read -r name _ text _; do printf " '%s[%s]'" "$name" "$(plain "$text")"; done < <(options '')
  printf '\n    return\n  fi\n  local command=$words[2]\n  shift words\n  ((CURRENT--))\n  case $command in\n'
  while IFS=$'\t' read -r command _; do
    printf '    %s)\n      _arguments' "$command"
    while IFS=$'\037' read -r name argument text values; do
      local action=' '
      if [[ $name == --set ]]; then
        name="*$name" action=' _bromwich_parameters'
      elif [[ -n $values ]]; then
        action="($values)"
      elif [[ $argument == *FILE* ]]; then
        action=_files
      fi
      printf " \\\\\n        '%s[%s]" "$name" "$(plain "$text")"
      [[ -z $argument ]] || printf ':%s:%s' "$argument" "$action"
      printf "'"
    done < <(options "$command")
    [[ $command != bench ]] || printf " \\\\\n        '1:benchmark:(%s)'" "$benchmarks"
    printf " \\\\\n        '*:file:_files' ;;\n"
  done <<<"$commands"
  printf '  esac\n}\n_bromwich "$@"\n'
}

write_bash >"$out/bash/bromwich"
write_zsh >"$out/zsh/_bromwich"

# Lines of examples stay lines.
keep_lines() { awk '/^\.IP$/ { print; print ".nf"; on = 1; next } on && /^\./ { print ".fi"; on = 0 } { print } END { if (on) print ".fi" }'; }

# manual NAME DESCRIPTION [COMMAND]
manual() {
  "$help2man" --no-info --no-discard-stderr --name "$2" --version-string "$("$bromwich" --version | cut -d' ' -f2)" \
    "$bromwich${3:+ $3}" | sed -E "1,3s/^\.TH \S+/.TH ${1^^}/; 1,5s/^bromwich (\S+) ([\]-)/bromwich-\1 \2/" | keep_lines >"$out/man1/$1.1"
}
if [[ -n $help2man ]]; then
  manual bromwich "solve linear complementarity systems (nonsmooth dynamics)"
  while IFS=$'\t' read -r command text; do manual "bromwich-$command" "$text" "$command"; done <<<"$commands"
fi
