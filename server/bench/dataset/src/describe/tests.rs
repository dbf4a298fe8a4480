mod flat;
mod houses;
