// `bromwich check`: what is known of a scene before it is solved, or of a result that was written.

#include "app/arguments.hpp"
#include "app/backend_choice.hpp"
#include "app/commands.hpp"
#include "app/interaction.hpp"
#include "app/machine.hpp"
#include "app/nonlinear_solve.hpp"
#include "app/output_json.hpp"
#include "app/result_check.hpp"
#include "app/scene_check.hpp"
#include "app/text.hpp"
#include "core/base/error.hpp"

namespace bromwich::app {

int run_check(const CheckArguments& arguments) {
  const Words words = split_words(arguments.words, arguments.settings);
  if (const std::string name = scene_name(words); names_result(name)) {
    const report::ResultTable table = report::read_result("RESULT", name);
    const ResultCheck check = check_result(name, table);
    print(arguments.json ? (table.summary.empty() ? "{}" : table.summary) + "\n" : check.text);
    return check.solved ? exit_solved : exit_not_solved;
  }
  const SceneChoice choice =
      choose_scene_or_system(scene_name(words), parse_settings(words.settings, scene_name(words)));
  Options options;
  if (choice.system)
    parse_nonlinear_method(arguments.method);
  else
    options.method = parse_method(arguments.method);
  if (!arguments.steps.empty()) options.steps = parse_steps(arguments.steps);
  parse_states("--states", arguments.states.empty() ? choice.states : arguments.states, choice.scene, options);
  options.memory_limit = memory_bytes();
  const auto backend = choose_backend(arguments.backend, choice.scene, options, 0, 0);
  const SceneCheck check = check_scene(choice, *backend, options);
  print(arguments.json ? dump(check_json(choice, check)) : check_text(choice, check));
  if (check.refusal.empty()) return exit_solved;
  complain(check.refusal);
  return exit_bad_input;
}

}  // namespace bromwich::app
