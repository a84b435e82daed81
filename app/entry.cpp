#include "app/commands.hpp"

int main(int argc, char** argv) { return bromwich::app::command(argc, argv); }
