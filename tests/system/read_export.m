% Reads one MAT export beside the CSV export of the same session, as read_exports.py calls it:
%   octave-cli read_export.m FILE.mat FOLDER OUT.txt
% The numbers have to be the same doubles; what the structs say is written to OUT.txt, a `path<TAB>value` a line.
1;
function tell(out, path, value)
  if isstruct(value)
    for key = fieldnames(value)'
      tell(out, [path '.' key{1}], value.(key{1}));
    end
  elseif ischar(value)
    fprintf(out, '%s\t%s\n', path, strrep(value, "\n", '\n'));
  elseif isinteger(value)
    fprintf(out, '%s\t%d\n', path, value);
  elseif isnumeric(value) && isscalar(value)
    fprintf(out, '%s\t%.17g\n', path, value);
  end
end

arguments = argv();
s = load(arguments{1});
out = fopen(arguments{3}, 'w');
for name = {'frame', 'pressure', 'setpoints'}
  file = fullfile(arguments{2}, [name{1} '.csv']);
  in = fopen(file);
  columns = strsplit(strtrim(fgetl(in)), ',');
  fclose(in);
  table = dlmread(file, ',', 1, 0, 'emptyvalue', NaN);
  assert(isequal(fieldnames(s.(name{1}))', columns), [name{1} ': other columns']);
  for c = 1:numel(columns)
    values = s.(name{1}).(columns{c});
    if strcmp(columns{c}, 'mono_ns')
      assert(class(values), 'int64');
    else
      assert(class(values), 'double');
    end
    assert(isequaln(double(values), table(:, c)), [name{1} '.' columns{c} ': other values']);
  end
end
tell(out, 'recording', s.recording);
tell(out, 'info', s.info);
for name = {'sessions', 'steps', 'ramps', 'holds', 'events'}
  for key = fieldnames(s.(name{1}))'
    column = s.(name{1}).(key{1});
    for i = 1:numel(column)
      value = column(i);
      if iscell(value)
        value = value{1};
      end
      tell(out, sprintf('%s.%s.%d', name{1}, key{1}, i), value);
    end
  end
end
fclose(out);
