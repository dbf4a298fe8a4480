-- A method has a type, declared by its team.
ALTER TABLE runs ADD COLUMN method_type TEXT; -- MethodType; null for none
